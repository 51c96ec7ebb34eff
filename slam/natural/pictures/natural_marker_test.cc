#include "slam/natural/pictures/natural_marker.h"

#include <gtest/gtest.h>

#include "slam/natural/pictures/alike_pictures.h"
#include "slam/testing/seen_picture.h"

namespace waymark::slam {
namespace {

using testing::poster;
using testing::viewOf;

std::string reasonFor(const cv::Mat& image, double width_m = 0.3) {
  const auto marker = NaturalMarker::create(viewOf(image), width_m, 0.0);
  return marker ? std::string() : marker.error().message;
}

TEST(NaturalMarker, TakesAPosterAndItsShape) {
  const auto marker = NaturalMarker::create(viewOf(poster(1, 800, 600)), 0.4, 0.0);
  ASSERT_TRUE(marker) << marker.error().message;
  EXPECT_DOUBLE_EQ(marker->height_m(), 0.3);
  EXPECT_GT(marker->quality().distinct_features, 50);
  EXPECT_GT(marker->features().size(), marker->features().upright);
}

TEST(NaturalMarker, ReducesWhatIsLarge) {
  cv::Mat large;
  cv::resize(poster(1, 800, 600), large, cv::Size(8000, 6000));
  const auto marker = NaturalMarker::create(viewOf(large), 0.4, 0.0);
  ASSERT_TRUE(marker) << marker.error().message;
  EXPECT_EQ(marker->grey().level(0).width, NaturalMarkerOptions{}.max_side_px);
  EXPECT_DOUBLE_EQ(marker->height_m(), 0.3);
}

TEST(NaturalMarker, SaysWhyAPictureWillNotDo) {
  EXPECT_EQ(reasonFor(cv::Mat(300, 400, CV_8U, cv::Scalar(200))), "is a uniform picture");
  EXPECT_EQ(reasonFor(poster(1), 0.0), "its width must be positive, metres");
  EXPECT_NE(reasonFor(poster(1, 40, 30)).find("too small"), std::string::npos);
  cv::Mat tiles(480, 640, CV_8U);
  const cv::Mat tile = poster(5, 40, 40);
  for (int y = 0; y < tiles.rows; ++y) {
    for (int x = 0; x < tiles.cols; ++x) {
      tiles.at<std::uint8_t>(y, x) = tile.at<std::uint8_t>(y % 40, x % 40);
    }
  }
  EXPECT_NE(reasonFor(tiles).find("self-similar"), std::string::npos) << reasonFor(tiles);
  cv::Mat soft(300, 400, CV_8U);
  for (int x = 0; x < soft.cols; ++x) soft.col(x).setTo(40 + x / 3);
  EXPECT_NE(reasonFor(soft).find("too little texture"), std::string::npos) << reasonFor(soft);
}

TEST(NaturalMarker, PointsAndPixelsBelongTogether) {
  const auto marker = NaturalMarker::create(viewOf(poster(2)), 0.3, 0.2);
  ASSERT_TRUE(marker);
  // The top-left pixel's outer corner is the print's.
  const Eigen::Vector2d corner = marker->toPixel({-0.15, 0.1});
  EXPECT_NEAR(corner.x(), -0.5, 1e-9);
  EXPECT_NEAR(corner.y(), -0.5, 1e-9);
  for (std::size_t i = 0; i < marker->features().size(); i += 37) {
    const Eigen::Vector2d pixel = marker->toPixel(marker->featurePoint(i));
    EXPECT_NEAR(pixel.x(), marker->features().features[i].x_px, 1e-3);
    EXPECT_NEAR(pixel.y(), marker->features().features[i].y_px, 1e-3);
  }
}

// A feature of a tilted view lies where one of the picture as it is does, of about the same size.
TEST(NaturalMarker, TiltedViewsShowTheSamePlaces) {
  const auto marker = NaturalMarker::create(viewOf(poster(3)), 0.3, 0.0);
  ASSERT_TRUE(marker);
  const FeatureSet& set = marker->features();
  int near = 0;
  int all = 0;
  for (std::size_t i = set.upright; i < set.size(); ++i, ++all) {
    for (std::size_t k = 0; k < set.upright; ++k) {
      const Feature& a = set.features[i];
      const Feature& b = set.features[k];
      if (std::hypot(a.x_px - b.x_px, a.y_px - b.y_px) > 2.5F) continue;
      if (a.size_px > 2.0F * b.size_px || b.size_px > 2.0F * a.size_px) continue;
      ++near;
      break;
    }
  }
  EXPECT_GT(all, 100);
  EXPECT_GT(near, all * 3 / 10);  // by chance it is less than one in fifteen
}

TEST(NaturalMarker, IsTheSameEveryTime) {
  const auto a = NaturalMarker::create(viewOf(poster(4)), 0.3, 0.0);
  const auto b = NaturalMarker::create(viewOf(poster(4)), 0.3, 0.0);
  ASSERT_TRUE(a);
  ASSERT_TRUE(b);
  EXPECT_EQ(a->features().descriptors, b->features().descriptors);
}

TEST(AlikePictures, AreFoundAmongOthers) {
  std::vector<NaturalMarker> markers;
  for (const unsigned seed : {10U, 11U, 12U}) {
    markers.push_back(NaturalMarker::create(viewOf(poster(seed)), 0.3, 0.0).value());
  }
  EXPECT_TRUE(findAlike(markers).empty());
  // The same poster once more, darker, with another number on it.
  cv::Mat changed = 0.8 * poster(11);
  cv::putText(changed, "42", cv::Point(200, 200), cv::FONT_HERSHEY_SIMPLEX, 2.0,
              cv::Scalar::all(250), 5, cv::LINE_AA);
  markers.push_back(NaturalMarker::create(viewOf(changed), 0.2, 0.0).value());
  const std::vector<AlikePictures> alike = findAlike(markers);
  ASSERT_EQ(alike.size(), 1U);
  EXPECT_EQ(alike[0].first, 1);
  EXPECT_EQ(alike[0].second, 3);
  EXPECT_GT(alike[0].share, 0.4);
}

}  // namespace
}  // namespace waymark::slam
