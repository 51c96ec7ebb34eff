#include "capture/libcamera/settings.h"

#include <array>
#include <cmath>
#include <utility>
#include <variant>

#include <libcamera/control_ids.h>
#include <libcamera/formats.h>
#include <linux/videodev2.h>

#include "base/image_view.h"
#include "capture/libcamera/compat.h"
#include "capture/pixel_format.h"

namespace waymark::capture::libcam {
namespace {

namespace controls = libcamera::controls;

constexpr double kUs = 1e6;  // in a second

const libcamera::PixelFormat* pixelFormatOf(const libcamera::StreamConfiguration& stream,
                                            std::uint32_t fourcc,
                                            std::vector<libcamera::PixelFormat>* all) {
  *all = stream.formats().pixelformats();
  for (const libcamera::PixelFormat& format : *all) {
    if (v4l2Fourcc(format) == fourcc) return &format;
  }
  return nullptr;
}

// As the control's own type. Empty when the value is of another kind.
std::optional<libcamera::ControlValue> valueFor(const libcamera::ControlId& control,
                                                const ControlValue& asked) {
  const auto* whole = std::get_if<std::int64_t>(&asked);
  const auto* flag = std::get_if<bool>(&asked);
  switch (control.type()) {
    case libcamera::ControlTypeBool:
      if (flag != nullptr) return libcamera::ControlValue(*flag);
      break;
    case libcamera::ControlTypeInteger32:
      if (whole != nullptr) return libcamera::ControlValue(static_cast<std::int32_t>(*whole));
      break;
    case libcamera::ControlTypeInteger64:
      if (whole != nullptr) return libcamera::ControlValue(*whole);
      break;
    case libcamera::ControlTypeFloat:
      if (whole != nullptr) return libcamera::ControlValue(static_cast<float>(*whole));
      if (const auto* number = std::get_if<double>(&asked)) {
        return libcamera::ControlValue(static_cast<float>(*number));
      }
      break;
    default:
      break;
  }
  return {};
}

// Bools count as 0 and 1; empty for what is no single number.
std::optional<double> asNumber(const libcamera::ControlValue& value) {
  if (value.isArray()) return {};
  switch (value.type()) {
    case libcamera::ControlTypeBool:
      return value.get<bool>() ? 1.0 : 0.0;
    case libcamera::ControlTypeInteger32:
      return value.get<std::int32_t>();
    case libcamera::ControlTypeInteger64:
      return static_cast<double>(value.get<std::int64_t>());
    case libcamera::ControlTypeFloat:
      return value.get<float>();
    default:
      return {};
  }
}

// Limits that are no numbers limit nothing.
bool isWithin(const libcamera::ControlValue& value, const libcamera::ControlInfo& info) {
  const std::optional<double> number = asNumber(value);
  const std::optional<double> min = asNumber(info.min());
  const std::optional<double> max = asNumber(info.max());
  return !number || ((!min || *number >= *min) && (!max || *number <= *max));
}

// A line for the user when it cannot be set.
std::optional<std::string> setNamed(const libcamera::Camera& camera, const std::string& name,
                                    const ControlValue& asked, libcamera::ControlList* list) {
  std::string known;
  for (const auto& [id, info] : camera.controls()) {
    if (id->name() == name) {
      const std::optional<libcamera::ControlValue> value = valueFor(*id, asked);
      if (!value || !isWithin(*value, info)) return name + ": must be within " + info.toString();
      list->set(id->id(), *value);
      return {};
    }
    known += (known.empty() ? "" : ", ") + id->name();
  }
  return name + ": the camera has no such control" + (known.empty() ? "" : "; it has " + known);
}

template <typename T>
bool has(const libcamera::Camera& camera, const libcamera::Control<T>& control) {
  return camera.controls().count(&control) > 0;
}

}  // namespace

std::optional<std::uint32_t> v4l2Fourcc(const libcamera::PixelFormat& format) {
  struct Name {
    libcamera::PixelFormat format;
    std::uint32_t fourcc;
  };
  // The display side names colours from the highest bits on, so in memory they lie the other way.
  static const std::array kOthers = {Name{libcamera::formats::R8, V4L2_PIX_FMT_GREY},
                                     Name{libcamera::formats::R10, V4L2_PIX_FMT_Y10},
                                     Name{libcamera::formats::R12, V4L2_PIX_FMT_Y12},
                                     Name{libcamera::formats::RGB888, V4L2_PIX_FMT_BGR24},
                                     Name{libcamera::formats::BGR888, V4L2_PIX_FMT_RGB24}};
  for (const Name& name : kOthers) {
    if (name.format == format) return name.fourcc;
  }
  // A modifier is a way of packing that none of our layouts is.
  return format.modifier() == 0 ? std::optional(format.fourcc()) : std::nullopt;
}

std::vector<OfferedMode> offeredModes(const libcamera::StreamConfiguration& stream) {
  std::vector<OfferedMode> all;
  const auto add = [&](std::uint32_t fourcc, const libcamera::SizeRange& range) {
    all.push_back({.fourcc = fourcc,
                   .min_width = static_cast<int>(range.min.width),
                   .max_width = static_cast<int>(range.max.width),
                   .width_step = std::max(1, static_cast<int>(range.hStep)),
                   .min_height = static_cast<int>(range.min.height),
                   .max_height = static_cast<int>(range.max.height),
                   .height_step = std::max(1, static_cast<int>(range.vStep)),
                   .rates_hz = {}});
  };
  for (const libcamera::PixelFormat& format : stream.formats().pixelformats()) {
    const std::optional<std::uint32_t> fourcc = v4l2Fourcc(format);
    if (!fourcc) continue;
    const std::vector<libcamera::Size> sizes = stream.formats().sizes(format);
    for (const libcamera::Size& size : sizes) add(*fourcc, libcamera::SizeRange(size));
    // Besides its usual sizes a camera may do any other of a range.
    if (sizes.size() != 1) add(*fourcc, stream.formats().range(format));
  }
  return all;
}

Result<ChosenMode> applyMode(const CameraOptions& options,
                             libcamera::CameraConfiguration* configuration) {
  libcamera::StreamConfiguration& stream = configuration->at(0);
  Result<ChosenMode> mode = chooseMode(offeredModes(stream), options);
  if (!mode) return mode;
  std::vector<libcamera::PixelFormat> formats;
  const libcamera::PixelFormat* const format = pixelFormatOf(stream, mode->fourcc, &formats);
  stream.pixelFormat = *format;
  stream.size = {static_cast<unsigned>(mode->width), static_cast<unsigned>(mode->height)};
  stream.bufferCount = static_cast<unsigned>(options.buffers);
  keepUpright(configuration);

  const bool valid = configuration->validate() != libcamera::CameraConfiguration::Invalid;
  const int width = static_cast<int>(stream.size.width);
  const int height = static_cast<int>(stream.size.height);
  if (!valid || stream.pixelFormat != *format || width != mode->width || height != mode->height) {
    return Error{"asked for " + fourccText(mode->fourcc) + " " +
                 sizeText(mode->width, mode->height) + ", the camera gives " +
                 (valid ? stream.pixelFormat.toString() + " " + sizeText(width, height)
                        : std::string("nothing"))};
  }
  return mode;
}

libcamera::ControlList startControls(const libcamera::Camera& camera, const CameraOptions& options,
                                     std::vector<std::string>* warnings) {
  libcamera::ControlList list(controls::controls);
  if (options.exposure_s && has(camera, controls::ExposureTime)) {
    if (has(camera, controls::AeEnable)) list.set(controls::AeEnable, false);
    list.set(controls::ExposureTime,
             static_cast<std::int32_t>(std::lround(*options.exposure_s * kUs)));
  } else if (options.exposure_s) {
    warnings->push_back("exposure_s: the camera's exposure time cannot be set");
  }
  if (options.rate_hz > 0.0 && has(camera, controls::FrameDurationLimits)) {
    const auto duration_us = static_cast<std::int64_t>(std::llround(kUs / options.rate_hz));
    const std::array<std::int64_t, 2> limits = {duration_us, duration_us};
    list.set(controls::FrameDurationLimits,
             libcamera::Span<const std::int64_t, 2>(limits.data(), limits.size()));
  } else if (options.rate_hz > 0.0) {
    warnings->push_back("the camera's rate cannot be set");
  }
  for (const auto& [name, asked] : options.controls) {
    if (std::optional<std::string> line = setNamed(camera, name, asked, &list)) {
      warnings->push_back(std::move(*line));
    }
  }
  return list;
}

}  // namespace waymark::capture::libcam
