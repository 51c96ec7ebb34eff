// Camera trajectories in TUM format: one line "time tx ty tz qx qy qz qw" per pose, seconds and
// metres, '#' begins a comment.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "base/result.h"
#include "slam/geometry/transform.h"

namespace waymark::io {

struct StampedPose {
  std::int64_t time_ns = 0;
  slam::Transform T_w_c;
};
using Trajectory = std::vector<StampedPose>;

// Poses come back in the order of the file. The error names the file and the line.
[[nodiscard]] Result<Trajectory> readTrajectory(const std::filesystem::path& path);

// Times with nine decimals, exact; positions to the nanometre. Equal input, equal bytes.
[[nodiscard]] std::string formatTrajectory(const Trajectory& trajectory);
[[nodiscard]] Status writeTrajectory(const std::filesystem::path& path,
                                     const Trajectory& trajectory);

}  // namespace waymark::io
