#include "slam/natural/pictures/picture_points.h"

#include <gtest/gtest.h>

#include "slam/testing/seen_picture.h"

namespace waymark::slam {
namespace {

TEST(PicturePoints, AreSpreadOverThePicture) {
  for (unsigned seed = 1; seed < 6; ++seed) {
    const auto marker = NaturalMarker::create(testing::viewOf(testing::poster(seed)), 0.3, 0.0);
    ASSERT_TRUE(marker);
    const auto points = picturePoints(*marker);
    ASSERT_GE(points.size(), 8U) << seed;
    // The first four reach into the four quarters.
    Eigen::Vector2d low(1.0, 1.0);
    Eigen::Vector2d high(-1.0, -1.0);
    for (std::size_t i = 0; i < 4; ++i) {
      low = low.cwiseMin(points[i]);
      high = high.cwiseMax(points[i]);
    }
    EXPECT_GT(high.x() - low.x(), 0.5 * 0.3) << seed;
    EXPECT_GT(high.y() - low.y(), 0.5 * 0.225) << seed;
    for (std::size_t i = 0; i < points.size(); ++i) {
      EXPECT_LT(std::abs(points[i].x()), 0.15);
      EXPECT_LT(std::abs(points[i].y()), 0.1125);
      for (std::size_t k = 0; k < i; ++k) EXPECT_GT((points[i] - points[k]).norm(), 0.01);
    }
  }
}

// Four dots in a picture of little else: they are the points.
TEST(PicturePoints, AreTheMostDistinctCorners) {
  cv::Mat image = testing::poster(3);
  cv::GaussianBlur(image, image, cv::Size(), 3.0);
  image = 0.3 * image + 80;
  const cv::Point dots[] = {{70, 60}, {400, 70}, {410, 290}, {80, 280}};
  for (const cv::Point& dot : dots) {
    cv::rectangle(image, dot, dot + cv::Point(12, 12), cv::Scalar::all(250), cv::FILLED);
  }
  const auto marker = NaturalMarker::create(testing::viewOf(image), 0.48, 0.36);
  ASSERT_TRUE(marker) << marker.error().message;
  const auto points =
      picturePoints(*marker, {.most = 4, .best_share = 0.0, .least_considered = 16});
  ASSERT_EQ(points.size(), 4U);
  for (const Eigen::Vector2d& point : points) {
    double nearest = 1.0;
    for (const cv::Point& dot : dots) {
      const Eigen::Vector2d at(0.001 * (dot.x + 6.5) - 0.24, 0.18 - 0.001 * (dot.y + 6.5));
      nearest = std::min(nearest, (at - point).norm());
    }
    EXPECT_LT(nearest, 0.015);
  }
}

TEST(PicturePoints, AsManyAsAskedFor) {
  const auto marker = NaturalMarker::create(testing::viewOf(testing::poster(1)), 0.3, 0.0);
  ASSERT_TRUE(marker);
  EXPECT_TRUE(picturePoints(*marker, {.most = 0}).empty());
  EXPECT_EQ(picturePoints(*marker, {.most = 3}).size(), 3U);
}

}  // namespace
}  // namespace waymark::slam
