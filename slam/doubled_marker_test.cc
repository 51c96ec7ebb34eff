// Two prints of one id in view, from the image to the map.
#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/slam.h"
#include "slam/testing/picture.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

using testing::kFramePeriodNs;
using testing::SyntheticMarker;

constexpr double kSize_m = 0.24;
constexpr std::uint8_t kWall = 180;

// What is seen in a pixel: the mean of rays spread over it. The lens is a pinhole.
class MarkerPainter {
 public:
  MarkerPainter(const CameraModel& camera, const Dictionary& dictionary)
      : camera_(camera), dictionary_(dictionary) {}

  void paint(const Transform& T_w_c, const SyntheticMarker& marker,
             testing::Picture* picture) const {
    const Transform T_m_c = marker.T_w_m.inverse() * T_w_c;
    double left = 1e9, top = 1e9, right = -1e9, bottom = -1e9;  // pixels, of the paper
    for (const Eigen::Vector3d& corner : markerCorners(kSize_m * paper())) {
      const auto pixel = camera_.project(T_m_c.inverse() * corner);
      if (!pixel) return;
      left = std::min(left, pixel->x());
      right = std::max(right, pixel->x());
      top = std::min(top, pixel->y());
      bottom = std::max(bottom, pixel->y());
    }
    const int last_x = std::min(static_cast<int>(right) + 1, picture->width() - 1);
    const int last_y = std::min(static_cast<int>(bottom) + 1, picture->height() - 1);
    for (int y = std::max(static_cast<int>(top) - 1, 0); y <= last_y; ++y) {
      for (int x = std::max(static_cast<int>(left) - 1, 0); x <= last_x; ++x) {
        picture->at(x, y) = pixel(T_m_c, marker.id, x, y, picture->at(x, y));
      }
    }
  }

 private:
  // Of the paper with its margin of a cell, in sides of the print.
  [[nodiscard]] double paper() const { return 1.0 + 2.0 / dictionary_.cells(); }

  [[nodiscard]] std::uint8_t pixel(const Transform& T_m_c, int id, int x, int y,
                                   std::uint8_t behind) const {
    constexpr int kRays = 5;  // a side
    double sum = 0.0;
    for (int i = 0; i < kRays * kRays; ++i) {
      const int row = i / kRays;
      const Eigen::Vector2d at(x - 0.5 + (i % kRays + 0.5) / kRays, y - 0.5 + (row + 0.5) / kRays);
      sum += grey(T_m_c, id, at).value_or(behind);
    }
    return static_cast<std::uint8_t>(std::lround(sum / (kRays * kRays)));
  }

  // Empty beside the paper.
  [[nodiscard]] std::optional<double> grey(const Transform& T_m_c, int id,
                                           const Eigen::Vector2d& pixel) const {
    const Calibration& c = camera_.calibration();
    const Eigen::Vector3d ray =
        T_m_c.R * Eigen::Vector3d((pixel.x() - c.cx) / c.fx, (pixel.y() - c.cy) / c.fy, 1.0);
    const Eigen::Vector3d on_print = T_m_c.p - T_m_c.p.z() / ray.z() * ray;
    const double cell_m = kSize_m / dictionary_.cells();
    const double column = std::floor((on_print.x() + 0.5 * kSize_m) / cell_m);
    const double row = std::floor((0.5 * kSize_m - on_print.y()) / cell_m);
    const int cells = dictionary_.cells();
    if (column < -1 || row < -1 || column > cells || row > cells) return std::nullopt;
    const bool margin = column < 0 || row < 0 || column >= cells || row >= cells;
    const bool white =
        margin || dictionary_.white(id, static_cast<int>(row), static_cast<int>(column));
    return white ? 215.0 : 30.0;
  }

  const CameraModel& camera_;
  const Dictionary& dictionary_;
};

// Whoever moves along a wall of eight markers, of which one hangs twice from some frame on.
TEST(DoubledMarkers, AreCountedAndBannedWhereBothPrintsAreInTheImage) {
  constexpr int kDoubled = 5;
  constexpr int kFrames = 60;
  constexpr int kHungUp = 30;
  const CameraModel camera(
      Calibration{.width = 640, .height = 480, .fx = 520.0, .fy = 520.0, .cx = 319.5, .cy = 239.5});
  const Dictionary dictionary = *Dictionary::byName("ARUCO_MIP_36h12");
  const MarkerPainter painter(camera, dictionary);
  std::mt19937 rng(4);
  std::vector<SyntheticMarker> markers = testing::markerWall(2, 4, 0.55, &rng);
  Options options;
  options.markers.size_m = kSize_m;
  Slam slam(camera, dictionary, options);

  std::optional<Transform> T_v_w;
  int with_both = 0;
  for (int i = 0; i < kFrames; ++i) {
    if (i == kHungUp) {
      ASSERT_NE(slam.map().findPosed(kDoubled), nullptr) << "or nothing would be at stake";
      markers.push_back({kDoubled, testing::markerFacing({0.1, 3.0, 0.75}, {0.0, 1.0, 0.6})});
    }
    const double s = 0.02 * i;
    const Transform T_w_c =
        testing::lookAt({-0.6 + s, 0.2 * s, 0.1 * s}, {-0.1 + 0.2 * s, 3.0, 0.1});
    testing::Picture picture(camera.width(), camera.height(), kWall);
    for (const SyntheticMarker& marker : markers) painter.paint(T_w_c, marker, &picture);
    const FrameTime time{static_cast<std::uint64_t>(i), i * kFramePeriodNs};
    const FrameResult result = slam.process({.time = time, .image = picture.view()});
    with_both += std::ranges::count(result.detections, kDoubled, &MarkerDetection::id) == 2 ? 1 : 0;
    if (!result.pose) {
      EXPECT_FALSE(T_v_w) << "frame " << i << ": " << describe(result.reason);
      continue;
    }
    if (!T_v_w) T_v_w = result.pose->T_w_c * T_w_c.inverse();
    EXPECT_LT((result.pose->T_w_c.p - (*T_v_w * T_w_c).p).norm(), 0.03) << "frame " << i;
  }
  EXPECT_GT(with_both, 10);
  EXPECT_GE(slam.counters().doubled_markers, 3U);
  EXPECT_EQ(slam.counters().refused_markers, 1U);
  EXPECT_EQ(slam.map().find(kDoubled)->state, MarkerState::kBanned);
  EXPECT_GT(slam.counters().quads, 0U) << "what the detector counts is told as well";
}

}  // namespace
}  // namespace waymark::slam
