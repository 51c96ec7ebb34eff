// How far poses are off over time, as a figure (seed 2, figures 5 to 8).
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace waymark::bench {

// A frame with a pose.
struct GapSample {
  double time_s = 0.0;
  Eigen::Vector3d error_m = Eigen::Vector3d::Zero();  // in the scene's world, z up
  double way_m = 0.0;                                 // estimated, since the first pose
};

// One run of a scene.
struct GapTrack {
  std::string name;
  std::vector<GapSample> samples;
};

// SVG: a panel for each axis' error and one for the distance travelled, a dot for each pose, a
// colour for each track. Times from 0 to duration_s.
[[nodiscard]] std::string gapFigure(const std::vector<GapTrack>& tracks, double duration_s);

}  // namespace waymark::bench
