#include "slam/natural/pictures/picture_matcher.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/geometry/homography.h"
#include "slam/natural/pictures/picture_pose.h"
#include "slam/testing/seen_picture.h"

namespace waymark::slam {
namespace {

constexpr double kFocal_px = 520.0;

// Features of a print as an ideal camera sees them, and some that are nowhere.
class PictureMatcherTest : public ::testing::Test {
 protected:
  void see(const Transform& T_c_p, double noise_px, std::size_t wrong) {
    std::mt19937 rng(4);
    std::normal_distribution<double> noise(0.0, noise_px / kFocal_px);
    std::uniform_real_distribution<double> anywhere(-0.4, 0.4);
    image_.clear();
    matches_.clear();
    for (std::size_t i = 0; i < marker_.features().upright; i += 5) {
      const Feature& feature = marker_.features().features[i];
      const Eigen::Vector2d at = marker_.featurePoint(i);
      const double step = 1e-5;
      const Eigen::Vector2d way(std::cos(feature.angle_rad), -std::sin(feature.angle_rad));
      const auto project = [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
        return (T_c_p * Eigen::Vector3d(p.x(), p.y(), 0.0)).hnormalized();
      };
      const Eigen::Vector2d ahead = project(at + step * way) - project(at);
      image_.push_back({project(at) + Eigen::Vector2d(noise(rng), noise(rng)),
                        feature.size_px * marker_.pixel_m() * ahead.norm() / step,
                        ahead.normalized()});
      matches_.push_back({static_cast<int>(image_.size()) - 1, static_cast<int>(i), 0.6});
    }
    const std::size_t right = matches_.size();
    for (std::size_t i = 0; i < wrong; ++i) {
      image_.push_back({{anywhere(rng), anywhere(rng)}, 0.01, {1.0, 0.0}});
      const auto feature = static_cast<int>(rng() % marker_.features().upright);
      matches_.insert(matches_.begin() + static_cast<std::ptrdiff_t>(rng() % (right + i)),
                      {static_cast<int>(image_.size()) - 1, feature, 0.6});
    }
  }

  NaturalMarker marker_ =
      NaturalMarker::create(testing::viewOf(testing::poster(2)), 0.3, 0.0).value();
  std::vector<ImageFeature> image_;
  std::vector<PictureFeatureMatch> matches_;
};

TEST_F(PictureMatcherTest, FindsThePlaceAmongWrongMatches) {
  const Transform truth = testing::pictureAt(0.8, 0.7, 0.5, 0.4);
  see(truth, 0.4, 2 * marker_.features().upright / 5);
  const auto found = locatePicture(3, marker_, image_, matches_, kFocal_px, 1);
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found[0].picture, 3);
  EXPECT_GT(found[0].inliers.size(), marker_.features().upright / 7);
  const auto pose = poseFromMatches(found[0], marker_, image_, kFocal_px);
  ASSERT_TRUE(pose);
  EXPECT_LT((pose->p - truth.p).norm(), 0.01);
  EXPECT_LT(rotationDistance(pose->R, truth.R), 0.05);
}

TEST_F(PictureMatcherTest, TheSameSeedFindsTheSame) {
  see(testing::pictureAt(0.8, 0.7, 0.5, 0.4), 0.4, 50);
  const auto a = locatePicture(0, marker_, image_, matches_, kFocal_px, 1);
  const auto b = locatePicture(0, marker_, image_, matches_, kFocal_px, 1);
  ASSERT_FALSE(a.empty());
  EXPECT_EQ(a[0].H, b[0].H);
}

TEST_F(PictureMatcherTest, ChanceIsNoPlace) {
  see(testing::pictureAt(0.8, 0.7, 0.5, 0.4), 0.4, 80);
  std::erase_if(matches_, [&](const PictureFeatureMatch& match) {
    return static_cast<std::size_t>(match.image_feature) < marker_.features().upright / 5;
  });
  for (const auto& found : locatePicture(0, marker_, image_, matches_, kFocal_px, 1)) {
    EXPECT_LT(found.inliers.size(), 8U);
  }
}

TEST_F(PictureMatcherTest, PointsOnALineAreNoPlace) {
  see(testing::pictureAt(0.8, 0.7, 0.5, 0.4), 0.4, 0);
  for (ImageFeature& feature : image_) feature.normalized.y() = 0.2 * feature.normalized.x();
  EXPECT_TRUE(locatePicture(0, marker_, image_, matches_, kFocal_px, 1).empty());
  for (ImageFeature& feature : image_) feature.normalized.setZero();
  EXPECT_TRUE(locatePicture(0, marker_, image_, matches_, kFocal_px, 1).empty());
  EXPECT_TRUE(locatePicture(0, marker_, image_, {}, kFocal_px, 1).empty());
}

TEST_F(PictureMatcherTest, AMirroredPictureIsNone) {
  see(testing::pictureAt(0.8, 0.3, 0.5, 0.4), 0.2, 0);
  for (ImageFeature& feature : image_) {
    feature.normalized.x() *= -1.0;
    feature.direction.x() *= -1.0;
  }
  EXPECT_TRUE(locatePicture(0, marker_, image_, matches_, kFocal_px, 1).empty());
}

}  // namespace
}  // namespace waymark::slam
