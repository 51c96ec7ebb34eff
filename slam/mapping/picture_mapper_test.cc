#include "slam/mapping/picture_mapper.h"

#include <random>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/geometry/turned_covariance.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr int kCarriedFrom = 3;

PicturePrint posterPrint() {
  PicturePrint print;
  print.name = "poster";
  print.width_m = 0.3;
  print.height_m = 0.4;
  return print;
}

// A poster on a wall, and a camera before it whose poses are known.
class PictureMapperTest : public ::testing::Test {
 protected:
  PictureMapperTest() {
    map_.addPicture(posterPrint());
    map_.addMarker(kCarriedFrom, 0.15);
    map_.place(kCarriedFrom, Transform{});
    seen_covariance_.diagonal() << 4e-6, 4e-6, 4e-6, 4e-6, 4e-6, 4e-6;
    pose_covariance_.diagonal() << 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6;
  }

  // From x metres along the wall; off_m: how far the poster seems to be from where it is.
  std::optional<PictureJoint> look(double x_m, double off_m = 0.0, int anchor = -1) {
    const Eigen::Vector3d eye(x_m, -1.0, 0.0);
    const Transform T_w_c = testing::lookAt(eye, T_w_p_.p);
    Transform seen = T_w_p_;
    seen.p.x() += off_m;
    LateResult result;
    result.sequence = ++sequence_;
    result.landmark = id_;
    result.T_m_c = seen.inverse() * T_w_c;
    result.covariance = seen_covariance_;
    AwaitedFrame frame{.time = {sequence_, static_cast<std::int64_t>(sequence_) * 100'000'000},
                       .T_w_c = T_w_c,
                       .covariance = pose_covariance_,
                       .anchor = anchor};
    auto joint = mapper_.offer(frame, result, map_);
    if (!joint) return joint;
    if (joint->T_w_m) map_.place(id_, *joint->T_w_m, {}, joint->covariance);
    if (joint->moved) map_.quarantine(id_);
    for (const Keyframe& keyframe : joint->keyframes) map_.addKeyframe(keyframe);
    return joint;
  }

  const int id_ = pictureId("poster");
  Transform T_w_p_ = testing::markerFacing({0.2, 1.0, 0.1}, {0.2, -1.0, 0.0});
  PictureMapperOptions options_;
  PictureMapper mapper_{options_};
  Map map_;
  Matrix6d seen_covariance_ = Matrix6d::Zero();
  Matrix6d pose_covariance_ = Matrix6d::Zero();
  std::uint64_t sequence_ = 0;
};

TEST_F(PictureMapperTest, FramesThatAgreePlaceAPicture) {
  EXPECT_FALSE(look(0.0));
  EXPECT_FALSE(look(0.3));
  const auto joint = look(0.6);
  ASSERT_TRUE(joint && joint->T_w_m);
  EXPECT_LT((joint->T_w_m->p - T_w_p_.p).norm(), 1e-9);
  ASSERT_EQ(joint->keyframes.size(), 3U);
  for (const Keyframe& keyframe : joint->keyframes) {
    ASSERT_EQ(keyframe.links.size(), 1U);
    const Transform T_w_p = keyframe.T_w_c * keyframe.links[0].T_c_m;
    EXPECT_LT((T_w_p.p - T_w_p_.p).norm(), 1e-9);
  }
  EXPECT_EQ(map_.linkedFrom(id_).size(), 3U);
}

TEST_F(PictureMapperTest, OneThatIsElsewhereBeginsAnew) {
  EXPECT_FALSE(look(0.0));
  EXPECT_FALSE(look(0.3));
  EXPECT_FALSE(look(0.6, 0.2)) << "disagrees with both";
  EXPECT_FALSE(look(0.0));
  EXPECT_FALSE(look(0.3));
  EXPECT_TRUE(look(0.6));
}

// A camera that stands still says the same again and again: enough to know the place, as one view.
TEST_F(PictureMapperTest, ViewsFromOnePlaceAreOneView) {
  for (int i = 0; i < 2; ++i) EXPECT_FALSE(look(0.0));
  const auto joint = look(0.0);
  ASSERT_TRUE(joint && joint->T_w_m);
  EXPECT_EQ(joint->keyframes.size(), 1U);
}

TEST_F(PictureMapperTest, OtherViewsMakeItBetterUpToABound) {
  for (int i = 0; i < 3; ++i) (void)look(0.3 * i);
  EXPECT_FALSE(look(0.3)) << "from where it was seen already";
  std::size_t links = 3;
  for (int i = 0; i < 30; ++i) {
    if (look(-6.0 + 0.5 * i)) ++links;
  }
  EXPECT_EQ(map_.linkedFrom(id_).size(), links);
  EXPECT_EQ(links, options_.max_views);
}

TEST_F(PictureMapperTest, OneThatMovedIsDistrustedAndPlacedAnew) {
  for (int i = 0; i < 3; ++i) (void)look(0.3 * i);
  T_w_p_.p.x() += 0.5;
  for (int i = 1; i < options_.moved_after; ++i) EXPECT_FALSE(look(0.3 * i)) << i;
  const auto joint = look(0.0);
  ASSERT_TRUE(joint);
  EXPECT_TRUE(joint->moved);
  EXPECT_TRUE(map_.linkedFrom(id_).empty());
  EXPECT_FALSE(look(0.0));
  EXPECT_FALSE(look(0.3));
  ASSERT_TRUE(look(0.6));
  EXPECT_LT((map_.findPosed(id_)->T_w_m->p - T_w_p_.p).norm(), 1e-9);
}

// Carried poses say where the picture is of the marker that they were carried from; several of one
// stretch have its drift in common, and together say what one says.
TEST_F(PictureMapperTest, CarriedPosesLinkToWhereTheyCameFrom) {
  for (int i = 0; i < 2; ++i) EXPECT_FALSE(look(0.3 * i, 0.0, kCarriedFrom));
  const auto joint = look(0.6, 0.0, kCarriedFrom);
  ASSERT_TRUE(joint);
  ASSERT_EQ(joint->keyframes.size(), 3U);
  for (const Keyframe& keyframe : joint->keyframes) {
    ASSERT_EQ(keyframe.links.size(), 2U);
    EXPECT_EQ(keyframe.links[0].marker, kCarriedFrom);
    const Matrix6d at_marker = turnedCovariance(keyframe.T_w_c.R, keyframe.links[0].covariance);
    EXPECT_NEAR(at_marker(3, 3), 3.0 * pose_covariance_(3, 3), 1e-12);
  }
  // Of a stretch one more view, not one for each frame.
  int more = 0;
  for (int i = 0; i < 12; ++i) more += look(-5.0 + 0.8 * i, 0.0, kCarriedFrom) ? 1 : 0;
  EXPECT_EQ(more, 1);
  EXPECT_FALSE(look(-9.0, 0.0, id_)) << "carried from the picture itself";
}

TEST_F(PictureMapperTest, AnAnchorThatIsGoneLinksNothing) {
  map_.quarantine(kCarriedFrom);
  for (int i = 0; i < 6; ++i) EXPECT_FALSE(look(0.3 * i, 0.0, kCarriedFrom)) << i;
}

TEST_F(PictureMapperTest, OptionsAreChecked) {
  EXPECT_EQ(PictureMapperOptions{}.invalidReason(), "");
  EXPECT_NE((PictureMapperOptions{.min_views = 0}).invalidReason(), "");
  EXPECT_NE((PictureMapperOptions{.min_views = 3, .max_views = 2}).invalidReason(), "");
  EXPECT_NE((PictureMapperOptions{.max_chi2 = -1.0}).invalidReason(), "");
}

// What the inverse's covariance says, against many draws.
TEST(CovarianceOfInverse, IsThatOfManyDraws) {
  const Transform T = testing::lookAt({0.4, -1.0, 0.3}, {0.0, 1.0, 0.2});
  Matrix6d root = Matrix6d::Zero();
  root.diagonal() << 2e-3, 1e-3, 4e-3, 3e-3, 5e-3, 1e-3;
  root(4, 0) = 2e-3;
  const Matrix6d covariance = covarianceOfInverse(T, root * root.transpose());
  std::mt19937 rng(5);
  std::normal_distribution<double> normal;
  Matrix6d sum = Matrix6d::Zero();
  constexpr int kDraws = 4000;
  for (int i = 0; i < kDraws; ++i) {
    Vector6d z;
    for (double& value : z) value = normal(rng);
    const Vector6d error = T.inverse().localCoordinates(T.retract(root * z).inverse());
    sum += error * error.transpose() / kDraws;
  }
  EXPECT_LT((sum - covariance).norm(), 0.1 * covariance.norm());
}

}  // namespace
}  // namespace waymark::slam
