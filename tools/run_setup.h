// What `waymark run` was asked for, and all it needs for that.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "base/result.h"
#include "io/maps/old_map.h"
#include "io/text/text_file.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/geometry/calibration_fit.h"
#include "slam/geometry/camera_model.h"
#include "slam/options.h"
#include "tools/marker_arguments.h"
#include "tools/natural/late_results.h"
#include "tools/run_input.h"

namespace waymark::tools {

struct RunArguments {
  std::string source;
  std::string calibration;
  slam::CalibrationFit calibration_fit = slam::CalibrationFit::kExact;
  MarkerArguments markers;
  std::string out;
  std::string map_in;
  bool localize_only = false;
  bool refine_intrinsics = false;
  std::string save_detections;
  std::optional<double> fps;
  std::string natural;
  bool no_global = false;
  bool realtime = false;
  bool quiet = false;
};

// Everything a run needs, checked.
struct RunSetup {
  slam::CameraModel camera;
  slam::Dictionary dictionary;
  slam::Options options;
  std::unique_ptr<RunInput> input;
  std::string calibration_change;  // what was done to the calibration; usually nothing
  std::string calibration_name;    // of the lens as it was used in the end
  std::optional<io::OutputDirectory> output;
  std::optional<io::OutputDirectory> detections;  // the directory of --save-detections
  std::optional<io::OldMap> old_map;
  std::unique_ptr<LateResults> late;  // null without natural markers
};

// Opens and checks all of it; what is in the way of it is an error. Old results are kept.
[[nodiscard]] Result<RunSetup> prepareRun(const RunArguments& arguments);

}  // namespace waymark::tools
