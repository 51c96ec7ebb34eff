// A camera's controls by name: listed, set, read back and compared.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "capture/camera_options.h"
#include "capture/v4l2/device.h"

namespace waymark::capture::v4l2 {

struct Control {
  enum class Kind { kNumber, kSwitch, kMenu };
  std::uint32_t id = 0;
  // As other tools spell them: "Exposure Time, Absolute" is exposure_time_absolute.
  std::string name;
  Kind kind = Kind::kNumber;
  std::int64_t min = 0, max = 0, step = 1, standard = 0;
  std::vector<std::pair<std::int64_t, std::string>> menu;  // values and their names
  bool read_only = false;
  bool inactive = false;  // another control decides, such as an automatic
};

// Those that can be read and have a single value.
[[nodiscard]] std::vector<Control> listControls(const Device& device);

[[nodiscard]] std::optional<std::int64_t> readControl(const Device& device, const Control& control);

// "min 1, max 5000, step 1, default 156, is 250".
[[nodiscard]] std::string describeControl(const Control& control,
                                          std::optional<std::int64_t> value);

// The value a control would be set to: what the option says as one of its numbers. Empty when it is
// none of them, and then `objection` says what may be.
[[nodiscard]] std::optional<std::int64_t> controlValue(const Control& control,
                                                       const ControlValue& asked,
                                                       std::string* objection);

// Sets what is asked, switches and menus before numbers, since automatics decide whether numbers
// are taken, and reads all of it back. A line for each that is not as asked.
[[nodiscard]] std::vector<std::string> applyControls(const Device& device,
                                                     const CameraOptions& options);

// The exposure time in force, nanoseconds; 0 when the camera does not say or chooses it itself.
[[nodiscard]] std::int64_t exposureNs(const Device& device);

}  // namespace waymark::capture::v4l2
