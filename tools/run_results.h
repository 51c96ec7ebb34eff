// The files of `waymark run`.
#pragma once

#include <functional>
#include <string>

#include "base/result.h"
#include "io/text/text_file.h"
#include "slam/geometry/camera_model.h"
#include "slam/slam.h"
#include "tools/run_record.h"
#include "tools/run_setup.h"

namespace waymark::tools {

// Into the setup's output. `statistics` makes stats.json, given why it is incomplete. Where the
// disk is full, what fits.
[[nodiscard]] Status writeResults(const slam::Slam& slam,
                                  const std::function<std::string(const std::string&)>& statistics,
                                  const std::string& incomplete, const RunRecord& record,
                                  RunSetup& setup);

// --save-detections FILE, and its frames.csv.
[[nodiscard]] Status writeDetections(const std::string& file, const RunRecord& record,
                                     const slam::CameraModel& camera,
                                     io::OutputDirectory& directory);

}  // namespace waymark::tools
