#include "slam/detection/marker_detector.h"

#include <gtest/gtest.h>

#include "slam/testing/drawn_marker.h"

namespace waymark::slam {
namespace {

// A light wall on which markers are drawn upright or turned by quarters.
class MarkerDetectorTest : public ::testing::Test {
 protected:
  void draw(const Dictionary& dictionary, int id, int left, int top, int cell_px,
            int quarters = 0) {
    testing::drawMarker(dictionary, id, left, top, cell_px, quarters, &wall_);
  }

  CameraModel camera_{
      Calibration{.width = 640, .height = 480, .fx = 520.0, .fy = 520.0, .cx = 319.5, .cy = 239.5}};
  Dictionary dictionary_ = *Dictionary::byName("ARUCO_MIP_36h12");
  MarkerDetector detector_{camera_, dictionary_};
  testing::Picture wall_{camera_.width(), camera_.height(), 210};
};

TEST_F(MarkerDetectorTest, CornersBeginAtThePrintsTopLeft) {
  constexpr int kCell = 6;
  const int side = kCell * dictionary_.cells();
  draw(dictionary_, 3, 100, 80, kCell);
  draw(dictionary_, 9, 300, 80, kCell, 1);
  const auto& found = detector_.detect(wall_.view());
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].id, 3);
  EXPECT_EQ(found[0].hamming, 0);
  const Eigen::Vector2d left_top(100 - 0.5, 80 - 0.5);
  EXPECT_LT((found[0].pixels[0] - left_top).norm(), 0.05);
  EXPECT_LT((found[0].pixels[1] - left_top - Eigen::Vector2d(side, 0)).norm(), 0.05);
  EXPECT_LT((found[0].pixels[3] - left_top - Eigen::Vector2d(0, side)).norm(), 0.05);
  // Turned clockwise by a quarter, its top-left is at the top right.
  EXPECT_EQ(found[1].id, 9);
  EXPECT_LT((found[1].pixels[0] - Eigen::Vector2d(300 - 0.5 + side, 80 - 0.5)).norm(), 0.05);
}

TEST_F(MarkerDetectorTest, SmallMarkersAreRead) {
  draw(dictionary_, 5, 100, 80, 2);
  const auto& found = detector_.detect(wall_.view());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].id, 5);
}

// Which of them counts is not for the detector to say.
TEST_F(MarkerDetectorTest, TwoPrintsOfOneIdAreFoundBoth) {
  draw(dictionary_, 3, 100, 80, 6);
  draw(dictionary_, 3, 300, 200, 6);
  draw(dictionary_, 4, 300, 80, 6);
  const auto& found = detector_.detect(wall_.view());
  ASSERT_EQ(found.size(), 3U);
  EXPECT_EQ(found[0].id, 3);
  EXPECT_EQ(found[1].id, 3);
  EXPECT_GT((found[0].pixels[0] - found[1].pixels[0]).norm(), 200.0);
  EXPECT_EQ(found[2].id, 4);
}

// As where two thresholds outline it, or where it is followed and found by a search as well.
TEST_F(MarkerDetectorTest, OnePrintFoundTwiceIsThereOnce) {
  draw(dictionary_, 3, 100, 80, 6);
  draw(dictionary_, 3, 300, 200, 6);
  const std::vector<MarkerDetection> once = detector_.detect(wall_.view());
  ASSERT_EQ(once.size(), 2U);
  const std::uint64_t merged = detector_.counters().merged;
  detector_.begin();
  for (int i = 0; i < 3; ++i) {
    for (const MarkerDetection& print : once) {
      ASSERT_TRUE(detector_.confirm(wall_.view(), 3, print.normalized, nullptr));
    }
  }
  EXPECT_EQ(detector_.finish().size(), 2U);
  EXPECT_EQ(detector_.counters().merged, merged + 4);
}

TEST_F(MarkerDetectorTest, AWrongBitIsCorrectedAndCounted) {
  draw(dictionary_, 3, 100, 80, 6);
  const std::uint8_t grey = dictionary_.white(3, 2, 3) ? 30 : 200;
  for (int y = 0; y < 6; ++y) {
    for (int x = 0; x < 6; ++x) wall_.at(100 + 3 * 6 + x, 80 + 2 * 6 + y) = grey;
  }
  const auto& found = detector_.detect(wall_.view());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].id, 3);
  EXPECT_EQ(found[0].hamming, 1);
}

TEST_F(MarkerDetectorTest, WhatIsNoMarkerIsNotFound) {
  // A plain dark square.
  wall_.paint(30, [](int x, int y) { return x >= 100 && x < 160 && y >= 80 && y < 140; });
  draw(*Dictionary::byName("5X5_1000"), 7, 300, 80, 8);
  EXPECT_TRUE(detector_.detect(wall_.view()).empty());
  EXPECT_EQ(detector_.counters().quads, 2U);
  EXPECT_EQ(detector_.counters().no_edge + detector_.counters().no_code, 2U);
  (void)detector_.detect(wall_.view());
  EXPECT_EQ(detector_.counters().quads, 4U) << "since the start";
}

// Nor is it looked for beyond the image's border, where a gradient looks like a soft edge.
TEST_F(MarkerDetectorTest, AMarkerThatHasLeftTheImageIsNotConfirmed) {
  draw(dictionary_, 3, 100, 80, 6);
  ASSERT_EQ(detector_.detect(wall_.view()).size(), 1U);
  const MeasuredMarker before = detector_.measured().front();
  for (int y = 0; y < wall_.height(); ++y) {
    for (int x = 0; x < wall_.width(); ++x) wall_.at(x, y) = static_cast<std::uint8_t>(y / 2);
  }
  for (const double by : {-1.0, -0.25, -0.2, 1.0}) {
    std::array<Eigen::Vector2d, 4> corners = before.detection.normalized;
    for (Eigen::Vector2d& corner : corners) corner.x() += by;
    detector_.begin();
    EXPECT_FALSE(detector_.confirm(wall_.view(), 3, corners, &before)) << by;
  }
}

TEST_F(MarkerDetectorTest, CutOffMarkersAreNotFound) {
  draw(dictionary_, 3, camera_.width() - 48, 80, 6);  // up to the image's last column
  EXPECT_TRUE(detector_.detect(wall_.view()).empty());
}

}  // namespace
}  // namespace waymark::slam
