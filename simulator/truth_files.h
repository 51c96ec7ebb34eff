// The truth as files, in the formats of the recordings: calib.yml (OpenCV FileStorage), gt_map.json
// and gt_traj.txt (TUM: camera in world).
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "base/result.h"
#include "simulator/simulation.h"

namespace waymark::simulator {

[[nodiscard]] std::string calibrationText(const slam::Calibration& calibration);

// Where the markers are at the start. Of a doubled id only the original is listed.
[[nodiscard]] std::string mapText(const Simulation& simulation);

// "t tx ty tz qx qy qz qw\n" of one frame: `seconds` as it stands.
[[nodiscard]] std::string trajectoryLine(std::string_view seconds, const slam::Transform& T_w_c);

// The whole trajectory, frame k at k / rate.
[[nodiscard]] std::string trajectoryText(const Simulation& simulation);

// The file appears complete or not at all. An Error names it and the system's reason.
[[nodiscard]] Status writeWholeFile(const std::filesystem::path& path, std::string_view content);

}  // namespace waymark::simulator
