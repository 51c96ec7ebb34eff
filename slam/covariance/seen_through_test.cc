#include "slam/covariance/seen_through.h"

#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/reprojection.h"
#include "slam/testing/seen_picture.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kWidth_m = 0.4;
constexpr double kHeight_m = 0.3;
constexpr int kAcross = 21;

// A poster, point by point. Where a rolling shutter shows each of them: the pose of its row's time.
class SeenThroughTest : public ::testing::Test {
 protected:
  struct Point {
    Eigen::Vector3d p_m;
    Eigen::Vector2d pixel;
  };

  [[nodiscard]] static CameraModel lens(const IntrinsicVector& by = IntrinsicVector::Zero()) {
    const CameraModel usual(testing::testCalibration());
    return CameraModel(usual.withIntrinsics(usual.intrinsics() + by));
  }
  // Moves with `twist`; the middle row's pose is T_m_c.
  [[nodiscard]] std::vector<Point> seen(const CameraModel& camera, const Transform& T_m_c,
                                        double readout_s) const {
    std::vector<Point> points;
    for (int i = 0; i < kAcross * kAcross; ++i) {
      const int row = i / kAcross;
      const int column = i % kAcross;
      const Eigen::Vector3d p_m((column / (kAcross - 1.0) - 0.5) * kWidth_m,
                                (row / (kAcross - 1.0) - 0.5) * kHeight_m, 0.0);
      double late_s = 0.0;
      std::optional<Eigen::Vector2d> pixel;
      for (int k = 0; k < 20; ++k) {
        Transform T_m_row = T_m_c;
        T_m_row.p += T_m_c.R * (late_s * twist_.head<3>());
        T_m_row.R = T_m_c.R * expSo3(late_s * twist_.tail<3>());
        pixel = camera.project(T_m_row.inverse() * p_m);
        if (!pixel) break;
        late_s = readout_s * (pixel->y() / (camera.height() - 1) - 0.5);
      }
      if (pixel && camera.inImage(*pixel)) points.push_back({p_m, *pixel});
    }
    return points;
  }
  // As whoever knows the image alone would have it.
  [[nodiscard]] static PoseAtPlane foundWith(const CameraModel& camera,
                                             const std::vector<Point>& points,
                                             const Transform& guess) {
    const auto minimum = minimizePose(guess, 50, [&](const Transform& T_m_c, PoseNormal* normal) {
      for (const Point& point : points) {
        Projection projection;
        if (!projectPoint(T_m_c, point.p_m, &projection)) return false;
        Eigen::Matrix2d J_lens;
        const Eigen::Vector2d r = camera.distort(projection.normalized, &J_lens) - point.pixel;
        const Matrix26d J = J_lens * cameraJacobian(T_m_c, point.p_m, projection.J_point);
        normal->cost += r.squaredNorm();
        normal->H += J.transpose() * J;
        normal->g += J.transpose() * r;
      }
      return true;
    });
    EXPECT_TRUE(minimum);
    return {minimum->T, *inverseOf(minimum->normal.H)};
  }

  Twist twist_ = Twist::Zero();
  Transform T_m_c_ = testing::pictureAt(0.8, 0.6, 0.5, 0.3).inverse();
  CameraModel used_ = lens();
  CameraUncertainty by_now_{.camera = &used_};
};

double degreesBetween(const Transform& a, const Transform& b) {
  return rotationDistance(a.R, b.R) * 180.0 / M_PI;
}

TEST_F(SeenThroughTest, WhereNothingWasLearnedItIsAsItWasFound) {
  const PoseAtPlane found{T_m_c_, 1e-6 * Matrix6d::Identity()};
  twist_ << 0.3, 0.1, -0.2, 0.5, 0.1, 0.2;
  const auto same = seenThrough({.found_with = used_, .by_now = by_now_, .twist = twist_}, found,
                                kWidth_m, kHeight_m);
  ASSERT_TRUE(same);
  EXPECT_EQ(same->T_m_c.p, T_m_c_.p);
  EXPECT_EQ(same->T_m_c.R, T_m_c_.R);
  EXPECT_EQ(same->covariance, found.covariance);
}

// Found with a focal length 4 % too short and half of the distortion.
TEST_F(SeenThroughTest, AnotherLensMovesThePose) {
  IntrinsicVector wrong = IntrinsicVector::Zero();
  wrong << -21.0, -21.0, 6.0, -4.0, 0.1, 0.0, 0.0, 0.0, 0.0;
  const CameraModel found_with = lens(wrong);
  const PoseAtPlane found = foundWith(found_with, seen(used_, T_m_c_, 0.0), T_m_c_);
  EXPECT_GT((found.T_m_c.p - T_m_c_.p).norm(), 0.025);
  const auto pose =
      seenThrough({.found_with = found_with, .by_now = by_now_}, found, kWidth_m, kHeight_m);
  ASSERT_TRUE(pose);
  EXPECT_LT((pose->T_m_c.p - T_m_c_.p).norm(), 0.002);
  EXPECT_LT(degreesBetween(pose->T_m_c, T_m_c_), 0.2);
  EXPECT_EQ(pose->covariance, found.covariance) << "a lens that is exactly known";
}

// Also of a poster of which half is in the image.
TEST_F(SeenThroughTest, HalfOfItIsEnough) {
  T_m_c_.p += T_m_c_.R * Eigen::Vector3d(0.5, 0.2, 0.0);
  IntrinsicVector wrong = IntrinsicVector::Zero();
  wrong << -10.0, -10.0, 0.0, 0.0, 0.03, 0.0, 0.0, 0.0, 0.0;
  const CameraModel found_with = lens(wrong);
  const auto points = seen(used_, T_m_c_, 0.0);
  ASSERT_GT(points.size(), 60U);
  ASSERT_LT(points.size(), 300U);
  const PoseAtPlane found = foundWith(found_with, points, T_m_c_);
  const auto pose =
      seenThrough({.found_with = found_with, .by_now = by_now_}, found, kWidth_m, kHeight_m);
  ASSERT_TRUE(pose);
  const double before = (found.T_m_c.p - T_m_c_.p).norm();
  EXPECT_GT(before, 0.01);
  EXPECT_LT((pose->T_m_c.p - T_m_c_.p).norm(), 0.1 * before);
}

// Half a metre and 30 degrees a second, read within 20 ms: as the middle row's time has it.
TEST_F(SeenThroughTest, ARollingShutterIsTakenOut) {
  twist_ << 0.4, -0.3, 0.2, 0.2, 0.4, 0.3;
  for (const double readout_s : {0.02, -0.02}) {
    const PoseAtPlane found = foundWith(used_, seen(used_, T_m_c_, readout_s), T_m_c_);
    const double before = (found.T_m_c.p - T_m_c_.p).norm();
    EXPECT_GT(before, 0.004);
    const auto pose = seenThrough(
        {.found_with = used_, .by_now = by_now_, .readout_s = readout_s, .twist = twist_}, found,
        kWidth_m, kHeight_m);
    ASSERT_TRUE(pose);
    EXPECT_LT((pose->T_m_c.p - T_m_c_.p).norm(), 0.1 * before) << readout_s;
  }
}

// Drawn lenses and readout times, all taken for the middle of what is known: the covariance is that
// of the error.
TEST_F(SeenThroughTest, WhatIsNotKnownOfTheCameraIsInTheCovariance) {
  constexpr int kDraws = 400;
  Eigen::Matrix<double, 10, 1> sigmas;
  sigmas << 1.0, 1.0, 0.7, 0.7, 3e-3, 3e-3, 1e-4, 1e-4, 3e-3, 1.2e-3;
  by_now_.covariance = sigmas.cwiseAbs2().asDiagonal();
  twist_ << 0.3, -0.3, 0.2, 0.2, 0.3, 0.3;
  std::mt19937 rng(3);
  std::normal_distribution<double> normal;
  double nees = 0.0;
  double without = 0.0;
  for (int i = 0; i < kDraws; ++i) {
    Eigen::Matrix<double, 10, 1> drawn;
    for (Eigen::Index k = 0; k < 10; ++k) drawn[k] = sigmas[k] * normal(rng);
    const auto points = seen(lens(drawn.head<9>()), T_m_c_, drawn[9]);
    PoseAtPlane found = foundWith(used_, points, T_m_c_);
    found.covariance *= 1e-5;  // these points are exact
    const auto pose = seenThrough({.found_with = used_, .by_now = by_now_, .twist = twist_}, found,
                                  kWidth_m, kHeight_m);
    ASSERT_TRUE(pose);
    const Vector6d error = pose->T_m_c.localCoordinates(T_m_c_);
    nees += error.dot(pose->covariance.ldlt().solve(error)) / kDraws;
    without += error.dot(found.covariance.ldlt().solve(error)) / kDraws;
  }
  EXPECT_GT(nees, 5.4);
  EXPECT_LT(nees, 6.6);
  EXPECT_GT(without, 600.0);
}

// A lens that is bent back before the edge of the image has no ray there.
TEST_F(SeenThroughTest, NotWhereTheLensInUseSeesNothing) {
  T_m_c_.p += T_m_c_.R * Eigen::Vector3d(0.35, 0.25, 0.0);  // the poster in the image's corner
  IntrinsicVector bent = IntrinsicVector::Zero();
  bent[4] = -0.6;
  const CameraModel narrow = lens(bent);
  CameraUncertainty by_now{.camera = &narrow};
  EXPECT_FALSE(
      seenThrough({.found_with = used_, .by_now = by_now}, {T_m_c_, {}}, kWidth_m, kHeight_m));
}

}  // namespace
}  // namespace waymark::slam
