// The controls of the test camera: exposure, gain, brightness, white balance, mains frequency. They
// keep what they are told, within their limits, and are at their defaults after power-on. Tests
// only.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "tests/vm/uvc/bytes.h"

namespace waymark::testing {

enum class Control {
  kExposureMode,      // kExposureManual or kExposureAuto
  kExposurePriority,  // 1: automatic exposure may lower the frame rate
  kExposureTime,      // units of 0.1 ms; rejected while exposure is automatic
  kBrightness,
  kGain,
  kMainsFrequency,    // 0: ignored, 1: 50 Hz, 2: 60 Hz
  kWhiteBalance,      // kelvin; rejected while white balance is automatic
  kWhiteBalanceAuto,  // 0 or 1
};
inline constexpr std::size_t kControlCount = 8;

// Values of kExposureMode: bits, as UVC has them.
inline constexpr std::int32_t kExposureManual = 1;
inline constexpr std::int32_t kExposureAuto =
    8;  // "aperture priority": the camera chooses the time

struct ControlRange {
  std::int32_t minimum = 0;
  std::int32_t maximum = 0;
  std::int32_t step = 1;  // of kExposureMode: the modes there are, as bits
  std::int32_t initial = 0;
};
[[nodiscard]] const ControlRange& rangeOf(Control control);

// Why the last request was rejected, as the request error code control tells it.
enum class RequestError : std::uint8_t {
  kNone = 0,
  kWrongState = 2,
  kOutOfRange = 4,
  kInvalidUnit = 5,
  kInvalidControl = 6,
  kInvalidRequest = 7,
};

class UvcControls {
 public:
  UvcControls();

  [[nodiscard]] std::int32_t value(Control control) const {
    return values_[static_cast<std::size_t>(control)];
  }

  // One request of the host: GET_CUR and the like, or SET_CUR with `sent`. What goes back, which is
  // nothing for SET_CUR; empty where rejected.
  [[nodiscard]] std::optional<Bytes> handle(std::uint8_t request, std::uint8_t unit,
                                            std::uint8_t selector, ByteView sent);

  [[nodiscard]] RequestError lastError() const { return last_error_; }

 private:
  [[nodiscard]] std::optional<Bytes> get(Control control, std::uint8_t request);
  [[nodiscard]] std::optional<Bytes> set(Control control, ByteView sent);
  [[nodiscard]] std::optional<Bytes> reject(RequestError error);

  std::array<std::int32_t, kControlCount> values_;
  RequestError last_error_ = RequestError::kNone;
};

}  // namespace waymark::testing
