#include "slam/natural/start_limits.h"

#include <array>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

// A square of that side around (x, y), in an image of 640x480.
bool within(const StartLimits& limits, double x, double y, double side) {
  const double h = 0.5 * side;
  const std::array<Eigen::Vector2d, 4> corners = {
      Eigen::Vector2d(x - h, y - h), Eigen::Vector2d(x + h, y - h), Eigen::Vector2d(x + h, y + h),
      Eigen::Vector2d(x - h, y + h)};
  return isWithin(limits, corners, 640, 480);
}

TEST(StartLimits, ThePapersAreOfTheImage) {
  const StartLimits paper{.border = 0.15, .min_area = 0.1, .max_area = 0.9};
  EXPECT_EQ(paper.invalidReason(), "");
  EXPECT_TRUE(within(paper, 320, 240, 200));   // 13 % of the image
  EXPECT_FALSE(within(paper, 320, 240, 170));  // 9.4 %
  EXPECT_TRUE(within(paper, 198, 240, 200));   // 98 of 640 pixels are left
  EXPECT_FALSE(within(paper, 194, 240, 200));  // 94: less than 15 %
  EXPECT_FALSE(within(paper, 320, 170, 200));  // 70 of 480
  const StartLimits near{.border = 0.0, .min_area = 0.0, .max_area = 0.9};
  EXPECT_TRUE(within(near, 320, 240, 520));
  EXPECT_FALSE(within(near, 320, 240, 540));
}

TEST(StartLimits, WithoutAnyAllIsWithin) {
  EXPECT_TRUE(within({}, 320, 240, 3));
  EXPECT_TRUE(within({}, -30, 500, 200));
  EXPECT_TRUE(within({}, 320, 240, 2000));
}

TEST(StartLimits, NonsenseIsRefused) {
  EXPECT_NE((StartLimits{.border = 0.5}).invalidReason(), "");
  EXPECT_NE((StartLimits{.border = -0.1}).invalidReason(), "");
  EXPECT_NE((StartLimits{.min_area = 0.5, .max_area = 0.4}).invalidReason(), "");
  EXPECT_NE((StartLimits{.max_area = 1.1}).invalidReason(), "");
}

}  // namespace
}  // namespace waymark::slam
