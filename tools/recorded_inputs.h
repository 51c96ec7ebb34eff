// What a recording of the daemon says about how it was made, for running it again.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "capture/recorded_file.h"
#include "io/settings/slam_settings.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/picture_print.h"

namespace waymark::tools {

struct RecordedInputs {
  std::optional<slam::Calibration> calibration;
  std::optional<io::SlamSettings> settings;
  std::vector<slam::PicturePrint> prints;    // natural markers that the SLAM was told of
  std::optional<capture::RecordedFile> map;  // that the daemon began with
};

// Of an event log; of any other source, nothing. What is in there and cannot be used is an error
// that names the log and the file in it.
[[nodiscard]] Result<RecordedInputs> recordedInputs(const std::string& source);

}  // namespace waymark::tools
