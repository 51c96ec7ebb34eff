#include "tests/vm/uvc/uvc_controls.h"

#include <algorithm>
#include <iterator>

#include <linux/usb/video.h>

#include "tests/vm/uvc/uvc_descriptors.h"

namespace waymark::testing {
namespace {

struct ControlDefinition {
  std::uint8_t unit;
  std::uint8_t selector;
  std::uint8_t bytes;
  ControlRange range;
};

// In the order of Control.
constexpr std::array<ControlDefinition, kControlCount> kDefinitions = {{
    {kCameraTerminal,
     UVC_CT_AE_MODE_CONTROL,
     1,
     {kExposureManual, kExposureAuto, kExposureManual | kExposureAuto, kExposureAuto}},
    {kCameraTerminal, UVC_CT_AE_PRIORITY_CONTROL, 1, {0, 1, 1, 1}},
    {kCameraTerminal, UVC_CT_EXPOSURE_TIME_ABSOLUTE_CONTROL, 4, {1, 5000, 1, 156}},
    {kProcessingUnit, UVC_PU_BRIGHTNESS_CONTROL, 2, {-64, 64, 1, 0}},
    {kProcessingUnit, UVC_PU_GAIN_CONTROL, 2, {0, 255, 1, 64}},
    {kProcessingUnit, UVC_PU_POWER_LINE_FREQUENCY_CONTROL, 1, {0, 2, 1, 1}},
    {kProcessingUnit, UVC_PU_WHITE_BALANCE_TEMPERATURE_CONTROL, 2, {2800, 6500, 10, 4600}},
    {kProcessingUnit, UVC_PU_WHITE_BALANCE_TEMPERATURE_AUTO_CONTROL, 1, {0, 1, 1, 1}},
}};

const ControlDefinition& definitionOf(Control control) {
  return kDefinitions[static_cast<std::size_t>(control)];
}

std::optional<Control> findControl(std::uint8_t unit, std::uint8_t selector) {
  const auto found = std::ranges::find_if(kDefinitions, [&](const ControlDefinition& definition) {
    return definition.unit == unit && definition.selector == selector;
  });
  if (found == kDefinitions.end()) return std::nullopt;
  return static_cast<Control>(std::distance(kDefinitions.begin(), found));
}

Bytes encodeValue(std::int32_t value, std::uint8_t bytes) {
  Bytes encoded = ByteWriter().le32(static_cast<std::uint32_t>(value)).take();
  encoded.resize(bytes);
  return encoded;
}

// All values fit 16 bits with a sign, or are positive.
std::int32_t decodeValue(ByteView bytes) {
  if (bytes.size() == 1) return bytes[0];
  if (bytes.size() == 2) return static_cast<std::int16_t>(readLe16(bytes, 0));
  return static_cast<std::int32_t>(readLe32(bytes, 0));
}

bool isAllowed(Control control, std::int32_t value) {
  const ControlRange& range = rangeOf(control);
  if (control == Control::kExposureMode) return value == kExposureManual || value == kExposureAuto;
  return value >= range.minimum && value <= range.maximum &&
         (value - range.minimum) % range.step == 0;
}

}  // namespace

const ControlRange& rangeOf(Control control) { return definitionOf(control).range; }

UvcControls::UvcControls() {
  std::ranges::transform(kDefinitions, values_.begin(),
                         [](const ControlDefinition& d) { return d.range.initial; });
}

std::optional<Bytes> UvcControls::handle(std::uint8_t request, std::uint8_t unit,
                                         std::uint8_t selector, ByteView sent) {
  const std::optional<Control> control = findControl(unit, selector);
  if (!control) {
    return reject(unit == kCameraTerminal || unit == kProcessingUnit ? RequestError::kInvalidControl
                                                                     : RequestError::kInvalidUnit);
  }
  return request == UVC_SET_CUR ? set(*control, sent) : get(*control, request);
}

std::optional<Bytes> UvcControls::get(Control control, std::uint8_t request) {
  const ControlDefinition& definition = definitionOf(control);
  last_error_ = RequestError::kNone;
  switch (request) {
    case UVC_GET_CUR:
      return encodeValue(value(control), definition.bytes);
    case UVC_GET_MIN:
      return encodeValue(definition.range.minimum, definition.bytes);
    case UVC_GET_MAX:
      return encodeValue(definition.range.maximum, definition.bytes);
    case UVC_GET_RES:
      return encodeValue(definition.range.step, definition.bytes);
    case UVC_GET_DEF:
      return encodeValue(definition.range.initial, definition.bytes);
    case UVC_GET_INFO:
      return Bytes{UVC_CONTROL_CAP_GET | UVC_CONTROL_CAP_SET};
    case UVC_GET_LEN:
      return ByteWriter().le16(definition.bytes).take();
    default:
      return reject(RequestError::kInvalidRequest);
  }
}

std::optional<Bytes> UvcControls::set(Control control, ByteView sent) {
  // As cameras do: a time or a temperature can be set only where the camera does not choose it.
  const bool automatic =
      (control == Control::kExposureTime && value(Control::kExposureMode) == kExposureAuto) ||
      (control == Control::kWhiteBalance && value(Control::kWhiteBalanceAuto) == 1);
  if (automatic) return reject(RequestError::kWrongState);
  if (sent.size() != definitionOf(control).bytes) return reject(RequestError::kInvalidRequest);
  const std::int32_t wanted = decodeValue(sent);
  if (!isAllowed(control, wanted)) return reject(RequestError::kOutOfRange);
  values_[static_cast<std::size_t>(control)] = wanted;
  last_error_ = RequestError::kNone;
  return Bytes{};
}

std::optional<Bytes> UvcControls::reject(RequestError error) {
  last_error_ = error;
  return std::nullopt;
}

}  // namespace waymark::testing
