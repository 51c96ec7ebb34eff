// Recorded detections of a wall of markers, made without images. Tests only.
#pragma once

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <vector>

#include "slam/geometry/camera_model.h"
#include "slam/testing/synthetic.h"

namespace waymark::testing {

// 3 x 16 markers of 0.2 m, 0.5 m apart, ids row by row. A camera sees about a half of it.
struct MarkerWall {
  static constexpr double kSize_m = 0.2;
  static constexpr int kColumns = 16;

  MarkerWall() {
    std::mt19937 rng(11);
    markers = slam::testing::markerWall(3, kColumns, 0.5, &rng);
  }
  std::vector<slam::testing::SyntheticMarker> markers;
};

// detections.csv (and frames.csv) of a camera that moves along the wall from x to x, metres, in 60
// frames at 30 Hz. Corners have noise of 0.1 px.
inline void recordWall(const MarkerWall& wall, const slam::Calibration& calibration, double from_m,
                       double to_m, const std::filesystem::path& directory) {
  std::filesystem::create_directories(directory);
  std::ofstream detections(directory / "detections.csv");
  std::ofstream frames(directory / "frames.csv");
  detections.precision(12);
  frames.precision(12);
  const slam::CameraModel camera(calibration);
  std::mt19937 rng(3);
  constexpr int kFrames = 60;
  for (int i = 0; i < kFrames; ++i) {
    const double s = static_cast<double>(i) / (kFrames - 1);
    const double x = from_m + s * (to_m - from_m);
    const slam::Transform T_w_c =
        slam::testing::lookAt({x, -0.3 + 0.4 * s, 0.3 * std::sin(9 * s)}, {0.8 * x, 3.0, 0.0});
    const double time_s = 1.0 + i / 30.0;
    frames << time_s << "\n";
    for (const slam::MarkerDetection& d :
         slam::testing::observeAll(camera, T_w_c, wall.markers, MarkerWall::kSize_m, 0.1, &rng)) {
      detections << time_s << "," << d.id << ",0";
      for (std::size_t k = 4; k-- > 0;) {
        detections << "," << d.pixels[k].x() << "," << d.pixels[k].y();
      }
      detections << "\n";
    }
  }
}

}  // namespace waymark::testing
