#include "slam/natural/pictures/picture_relocalizer.h"

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/testing/seen_picture.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kPosterWidth_m = 0.3;
constexpr double kPosterHeight_m = 0.225;

NaturalMarker posterNumber(unsigned number) {
  return NaturalMarker::create(testing::viewOf(testing::poster(number)), kPosterWidth_m, 0.0)
      .value();
}

// Posters 100, 101, ... in a row along x, two metres apart.
std::vector<PosedNaturalMarker> row(unsigned count) {
  std::vector<PosedNaturalMarker> pictures;
  for (unsigned i = 0; i < count; ++i) {
    Transform T_w_m;
    T_w_m.p.x() = 2.0 * i;
    pictures.push_back({static_cast<int>(i), posterNumber(100 + i), T_w_m});
  }
  return pictures;
}

class PictureRelocalizerTest : public ::testing::Test {
 protected:
  [[nodiscard]] cv::Mat seen(unsigned poster, const Transform& T_c_m) const {
    return testing::seenPicture(scene_, testing::poster(100 + poster), kPosterWidth_m,
                                kPosterHeight_m, T_c_m, 1);
  }

  testing::PictureScene scene_{.camera = CameraModel(testing::testCalibration())};
};

TEST_F(PictureRelocalizerTest, TellsWhereTheCameraWasOfThePicture) {
  PictureRelocalizer relocalizer(row(3));
  const Transform T_c_m = testing::pictureAt(0.6, 0.5, 0.7, 0.3);
  const cv::Mat image = seen(2, T_c_m);
  const auto results = relocalizer.locate(
      {.time = {41, 1'000}, .generation = 7, .image = testing::viewOf(image), .last = {}},
      scene_.camera);
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0].sequence, 41U);
  EXPECT_EQ(results[0].generation, 7U);
  EXPECT_EQ(results[0].landmark, 2);
  const Vector6d error = results[0].T_m_c.localCoordinates(T_c_m.inverse());
  EXPECT_LT(error.head<3>().norm(), 0.003);
  EXPECT_LT(error.dot(results[0].covariance.ldlt().solve(error)), 22.5);  // of 6: 99.9 %
  EXPECT_EQ(relocalizer.counts().searches, 1U);
  EXPECT_EQ(relocalizer.counts().located, 1U);
}

// The covariance of the inverse, against many draws.
TEST_F(PictureRelocalizerTest, TurnsTheCovarianceAround) {
  const Transform T_c_m = testing::pictureAt(1.3, 0.6, 0.4, 1.0);
  Matrix6d root = Matrix6d::Zero();
  root.diagonal() << 2e-3, 1e-3, 4e-3, 3e-3, 5e-3, 1e-3;
  root(4, 0) = 2e-3;
  const LateResult inverse = cameraInPicture(T_c_m, root * root.transpose());
  std::mt19937 rng(5);
  std::normal_distribution<double> normal;
  constexpr int kDraws = 4000;
  double nees = 0.0;
  Matrix6d sum = Matrix6d::Zero();
  for (int i = 0; i < kDraws; ++i) {
    Vector6d z;
    for (double& value : z) value = normal(rng);
    const Transform drawn = T_c_m.retract(root * z).inverse();
    const Vector6d error = inverse.T_m_c.localCoordinates(drawn);
    nees += error.dot(inverse.covariance.ldlt().solve(error)) / kDraws;
    sum += error * error.transpose() / kDraws;
  }
  EXPECT_NEAR(nees, 6.0, 0.25);
  EXPECT_LT((sum - inverse.covariance).norm(), 0.1 * inverse.covariance.norm());
}

TEST_F(PictureRelocalizerTest, LooksNearTheLastPlaceAndEverywhereWhenLost) {
  PictureRelocalizerOptions options;
  options.nearby.most = 1;
  PictureRelocalizer relocalizer(row(5), options);
  const cv::Mat image = seen(4, testing::pictureAt(0.6, 0.3, 0.7, 0.3));
  RelocalizationQuery query{
      .time = {1, 1'000}, .generation = 0, .image = testing::viewOf(image), .last = LastPlace{}};
  EXPECT_TRUE(relocalizer.locate(query, scene_.camera).empty());  // at the other end of the row
  query.last->T_w_c.p.x() = 8.0;
  EXPECT_EQ(relocalizer.locate(query, scene_.camera).size(), 1U);
  query.last->T_w_c.p.x() = 0.0;
  query.last->position_covariance = 4.0 * Eigen::Matrix3d::Identity();  // 3 sigma are 6 m
  EXPECT_EQ(relocalizer.locate(query, scene_.camera).size(), 1U);
  query.last.reset();
  EXPECT_EQ(relocalizer.locate(query, scene_.camera).size(), 1U);
  // One whose place is not known may be anywhere.
  query.last = LastPlace{};
  relocalizer.setPose(4, std::nullopt);
  EXPECT_EQ(relocalizer.locate(query, scene_.camera).size(), 1U);
}

TEST_F(PictureRelocalizerTest, WhatIsOpenIsNotTold) {
  std::vector<PosedNaturalMarker> pictures = row(2);
  pictures.push_back({2, posterNumber(101), {}});  // the second one's print, hung elsewhere
  PictureRelocalizer relocalizer(std::move(pictures));
  const cv::Mat image = seen(1, testing::pictureAt(0.6, 0.3, 0.7, 0.3));
  const RelocalizationQuery query{
      .time = {1, 1'000}, .generation = 0, .image = testing::viewOf(image), .last = {}};
  EXPECT_TRUE(relocalizer.locate(query, scene_.camera).empty());
  EXPECT_EQ(relocalizer.counts().alike, 2U);
  EXPECT_EQ(relocalizer.counts().located, 0U);
}

// Small, far and nearly from the front both poses of the plane look alike: what is told as decided
// is right. Who wants more of a decision is told both, one of which is right.
TEST_F(PictureRelocalizerTest, OfASmallPictureBothPosesAreKept) {
  PictureRelocalizer relocalizer(row(1));
  PictureRelocalizer cautious(row(1), {.min_ambiguity_ratio = 1e5});
  int decided = 0;
  int open = 0;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    const Transform T_c_m =
        testing::pictureAt(1.5 + 0.25 * (seed % 5), 0.04 * (seed % 6), 0.4 * seed, 0.1);
    const cv::Mat image = testing::seenPicture(scene_, testing::poster(100), kPosterWidth_m,
                                               kPosterHeight_m, T_c_m, seed);
    const auto nees = [&](const Transform& T_m_c, const Matrix6d& covariance) {
      const Vector6d error = T_m_c.localCoordinates(T_c_m.inverse());
      return error.dot(covariance.ldlt().solve(error));
    };
    const RelocalizationQuery query{
        .time = {seed, 1'000}, .generation = 0, .image = testing::viewOf(image), .last = {}};
    for (const LateResult& found : relocalizer.locate(query, scene_.camera)) {
      if (!found.decided) continue;
      ++decided;
      EXPECT_LT(nees(found.T_m_c, found.covariance), 22.5) << "seed " << seed;
    }
    for (const LateResult& found : cautious.locate(query, scene_.camera)) {
      EXPECT_EQ(found.decided, !found.other) << "seed " << seed;
      if (found.decided) continue;
      ++open;
      EXPECT_LT(found.ambiguity_ratio, 1e5);
      EXPECT_LT(std::min(nees(found.T_m_c, found.covariance),
                         nees(found.other->T_m_c, found.other->covariance)),
                22.5)
          << "seed " << seed;
    }
  }
  EXPECT_GT(decided, 4);
  EXPECT_GT(open, 0);
  EXPECT_EQ(cautious.counts().ambiguous, static_cast<std::uint64_t>(open));
}

TEST_F(PictureRelocalizerTest, AnEmptyImageHasNothing) {
  PictureRelocalizer relocalizer(row(1));
  const cv::Mat blank(480, 640, CV_8U, cv::Scalar(90));
  EXPECT_TRUE(
      relocalizer
          .locate(
              {.time = {1, 1'000}, .generation = 0, .image = testing::viewOf(blank), .last = {}},
              scene_.camera)
          .empty());
  PictureRelocalizer without(std::vector<PosedNaturalMarker>{});
  EXPECT_TRUE(
      without
          .locate(
              {.time = {1, 1'000}, .generation = 0, .image = testing::viewOf(blank), .last = {}},
              scene_.camera)
          .empty());
  EXPECT_NE((PictureRelocalizerOptions{.min_ambiguity_ratio = 0.5}).invalidReason(), "");
  EXPECT_EQ(PictureRelocalizerOptions{}.invalidReason(), "");
}

}  // namespace
}  // namespace waymark::slam
