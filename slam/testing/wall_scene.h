// A corridor with markers on one wall, and the views of somebody who walks along it: what is known
// of one marker by another gets less and less sure.
#pragma once

#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Geometry>

#include "slam/testing/synthetic.h"

namespace waymark::slam::testing {

inline constexpr double kWallMarker_m = 0.2;

// Ids along the wall, a metre apart from x = 0 on, upright; the wall is y = 3, and all face the
// camera. Out of the wall by sigma_m, and tilted by sigma_rad about both of its axes.
inline std::vector<SyntheticMarker> wallMarkers(int count, double sigma_m, double sigma_rad,
                                                std::mt19937* rng) {
  std::normal_distribution<double> noise(0.0, 1.0);
  std::vector<SyntheticMarker> markers;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d centre(i, 3.0 + sigma_m * noise(*rng), 0.4 * std::sin(2.0 * i));
    Transform T_w_m = markerFacing(centre, centre - Eigen::Vector3d::UnitY());
    const double about_x = sigma_rad * noise(*rng);
    const double about_z = sigma_rad * noise(*rng);
    T_w_m.R = Eigen::AngleAxisd(about_x, Eigen::Vector3d::UnitX()) *
              Eigen::AngleAxisd(about_z, Eigen::Vector3d::UnitZ()) * T_w_m.R;
    markers.push_back({i, T_w_m});
  }
  return markers;
}

// Two a metre, looking a little ahead.
inline std::vector<Transform> wallViews(int markers) {
  std::vector<Transform> views;
  for (int i = 0; i < 2 * markers - 2; ++i) {
    const Eigen::Vector3d eye(0.5 * i - 0.3, 0.2 * (i % 3), 0.15 * std::sin(1.3 * i));
    views.push_back(lookAt(eye, {eye.x() + 0.8, 3.0, 0.0}));
  }
  return views;
}

}  // namespace waymark::slam::testing
