// Markers in general position for the tests of file formats. Tests only.
#pragma once

#include <cmath>

#include <gtest/gtest.h>

#include "io/maps/posed_markers.h"

namespace waymark::io {

inline PosedMarkers someMarkers() {
  PosedMarkers markers;
  markers.dictionary = "APRILTAG_36h11";
  slam::Vector6d delta;
  delta << 0.1, -2.0, 0.3, 0.4, -0.5, 0.6;
  for (int i = 0; i < 5; ++i) {
    markers.markers.push_back({10 * i, 0.1 + 0.01 * i, slam::Transform{}.retract(i * delta)});
  }
  return markers;
}

// Sizes count only where `a` has one.
inline void expectSameMarkers(const PosedMarkers& a, const PosedMarkers& b) {
  ASSERT_EQ(a.markers.size(), b.markers.size());
  for (std::size_t i = 0; i < a.markers.size(); ++i) {
    EXPECT_EQ(a.markers[i].id, b.markers[i].id);
    if (a.markers[i].size_m > 0.0) {
      EXPECT_NEAR(a.markers[i].size_m, b.markers[i].size_m, 1e-12);
    }
    EXPECT_LT((a.markers[i].T_w_m.p - b.markers[i].T_w_m.p).norm(), 1e-12);
    EXPECT_LT((a.markers[i].T_w_m.R - b.markers[i].T_w_m.R).norm(), 1e-12);
  }
}

// Where the marker's corners are: those of a hand-checked example.
inline void expectCorners(const PosedMarker& marker, double size_m,
                          const std::array<Eigen::Vector3d, 4>& corners) {
  const double h = 0.5 * size_m;
  const std::array<Eigen::Vector3d, 4> own = {Eigen::Vector3d(-h, h, 0), Eigen::Vector3d(h, h, 0),
                                              Eigen::Vector3d(h, -h, 0),
                                              Eigen::Vector3d(-h, -h, 0)};
  for (std::size_t k = 0; k < 4; ++k) {
    EXPECT_LT((marker.T_w_m * own[k] - corners[k]).norm(), 1e-9) << "corner " << k;
  }
}

}  // namespace waymark::io
