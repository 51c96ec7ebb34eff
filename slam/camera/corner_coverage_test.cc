#include "slam/camera/corner_coverage.h"

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

// Cells of 64x60 pixels.
TEST(CornerCoverage, CountsEachCellOnce) {
  CornerCoverage coverage(640, 480);
  MarkerDetection detection;
  detection.pixels = {Eigen::Vector2d(10.0, 10.0), {50.0, 10.0}, {70.0, 70.0}, {10.0, 70.0}};
  EXPECT_EQ(coverage.add({&detection, 1}), 3) << "two corners are in one cell";
  EXPECT_EQ(coverage.add({&detection, 1}), 0);
  for (Eigen::Vector2d& pixel : detection.pixels) pixel.x() += 64.0;
  EXPECT_EQ(coverage.add({&detection, 1}), 2) << "one of them has had a corner before";
  EXPECT_EQ(coverage.add({}), 0);
}

TEST(CornerCoverage, BeyondTheBorderCountsForTheNearestCell) {
  CornerCoverage coverage(640, 480);
  MarkerDetection detection;
  detection.pixels = {Eigen::Vector2d(-0.6, -0.6), {639.6, 0.0}, {639.6, 479.6}, {0.0, 479.6}};
  EXPECT_EQ(coverage.add({&detection, 1}), 4);
  EXPECT_EQ(CornerCoverage::kCells, 80);
}

}  // namespace
}  // namespace waymark::slam
