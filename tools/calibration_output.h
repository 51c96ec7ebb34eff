// What `waymark calibrate` says and writes.
#pragma once

#include <string>

#include "io/text/text_file.h"
#include "tools/calibration/calibrator.h"

namespace waymark::tools {

// Of a whole run.
struct CalibrationRun {
  std::string source;      // as it describes itself
  std::string board;       // in words
  std::size_t frames = 0;  // looked at
  std::size_t with_board = 0;
};

// For people, several lines.
[[nodiscard]] std::string calibrationText(const CalibrationRun& run,
                                          const calibration::CalibrationReport& report);

// All numbers, JSON.
[[nodiscard]] std::string calibrationJson(const CalibrationRun& run,
                                          const calibration::CalibrationReport& report);

// calib.yml (OpenCV), camera_info.yaml (ROS), calibration.json and calibration.png.
void addCalibrationFiles(const CalibrationRun& run, const calibration::CalibrationReport& report,
                         io::OutputDirectory* output);

}  // namespace waymark::tools
