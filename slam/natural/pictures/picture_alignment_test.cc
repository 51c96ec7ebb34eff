#include "slam/natural/pictures/picture_alignment.h"

#include <gtest/gtest.h>

#include "slam/natural/pictures/photometric_fit.h"
#include "slam/natural/pictures/picture_pose.h"
#include "slam/testing/numeric.h"
#include "slam/testing/seen_picture.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kWidth_m = 0.3;

class PictureAlignmentTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::optional<PictureAlignment> align(const cv::Mat& image,
                                                      const Transform& start) {
    return alignPicture(marker_, GreyPyramid(testing::viewOf(image), 40), start, &rays_);
  }
  [[nodiscard]] cv::Mat seen(const Transform& T_c_p) const {
    return testing::seenPicture(scene_, print_, kWidth_m, marker_.height_m(), T_c_p, 1);
  }
  // Mean error of the corners, pixels at the image centre.
  [[nodiscard]] double cornerError_px(const Transform& a, const Transform& b) const {
    double sum = 0.0;
    for (const double x : {-0.5, 0.5}) {
      for (const double y : {-0.5, 0.5}) {
        const Eigen::Vector3d p(x * kWidth_m, y * marker_.height_m(), 0.0);
        sum += 0.25 * scene_.camera.focalLength() *
               ((a * p).hnormalized() - (b * p).hnormalized()).norm();
      }
    }
    return sum;
  }

  cv::Mat print_ = testing::poster(7);
  NaturalMarker marker_ = NaturalMarker::create(testing::viewOf(print_), kWidth_m, 0.0).value();
  testing::PictureScene scene_{.camera = CameraModel(testing::testCalibration())};
  PixelRays rays_{scene_.camera};
};

TEST_F(PictureAlignmentTest, JacobianIsThatOfTheImage) {
  const Transform T_c_p = testing::pictureAt(0.8, 0.5, 0.4, 0.2);
  const auto expected = expectPicture(marker_, T_c_p, 0, 3, &rays_);
  ASSERT_TRUE(expected);
  // An image that is what is expected.
  GreyLevels image{640, 480, std::vector<float>(640 * 480, 100.0F)};
  for (int y = 0; y < expected->height; ++y) {
    for (int x = 0; x < expected->width; ++x) {
      image.row(expected->top + y)[expected->left + x] = expected->grey[expected->index(x, y)];
    }
  }
  PhotometricFit fit(*expected, expected->grey, 2.0, T_c_p, scene_.camera, image);
  Light light;
  light << 5.0, 0.9, 0.05, -0.03, 0.02, 0.01, -0.04;
  ASSERT_GT(fit.pixels().size(), 1000U);
  const auto residuals = [&](const Transform& T) {
    fit.computeResiduals(T, light);
    Eigen::VectorXd r(fit.pixels().size());
    for (std::size_t i = 0; i < fit.pixels().size(); ++i) {
      r[static_cast<Eigen::Index>(i)] = fit.residuals()[i];
    }
    return r;
  };
  // Steps of some hundredths of a pixel: between pixels the image is linear.
  const auto numeric = testing::numericJacobian(T_c_p, residuals, 3e-5);
  double difference = 0.0;
  double size = 0.0;
  for (std::size_t i = 0; i < fit.pixels().size(); ++i) {
    const double gain = gainAt(fit.pixels()[i], light);
    const Eigen::Matrix<double, 1, 6> J = fit.jacobian(i, light).head<6>().transpose() / gain;
    difference += (numeric.row(static_cast<Eigen::Index>(i)) - J).squaredNorm();
    size += J.squaredNorm();
  }
  EXPECT_LT(std::sqrt(difference / size), 0.01);
  // The light's part is linear: exact.
  fit.computeResiduals(T_c_p, light);
  const std::vector<float> before = fit.residuals();
  for (int k = 0; k < 7; ++k) {
    fit.computeResiduals(T_c_p, light + 0.5 * Light::Unit(k));
    for (std::size_t i = 0; i < before.size(); i += 97) {
      EXPECT_NEAR(fit.residuals()[i] - before[i], 0.5 * fit.jacobian(i, light)[6 + k], 1e-3);
    }
  }
}

TEST_F(PictureAlignmentTest, ComesHomeFromPixelsAway) {
  for (const double distance_m : {0.5, 1.0, 1.8}) {
    const Transform truth = testing::pictureAt(distance_m, 0.5, 1.0, 0.4);
    const cv::Mat image = seen(truth);
    Vector6d off;
    off << 0.003 * distance_m, -0.003 * distance_m, 0.01 * distance_m, 0.03, -0.03, 0.01;
    const auto found = align(image, truth.retract(off));
    ASSERT_TRUE(found) << distance_m;
    EXPECT_GT(cornerError_px(truth.retract(off), truth), 1.0);
    // To a two-thousandth of its width in the image.
    const double width_px = scene_.camera.focalLength() * kWidth_m / distance_m;
    EXPECT_LT(cornerError_px(found->T_c_p, truth), 0.0005 * width_px) << distance_m;
    EXPECT_GT(found->correlation, 0.95);
    EXPECT_GT(found->agreeing_share, 0.9);
  }
}

TEST_F(PictureAlignmentTest, WhatHidesThePictureIsLeftOut) {
  const Transform truth = testing::pictureAt(0.7, 0.4, 2.0, 0.1);
  cv::Mat image = seen(truth);
  // The left half of the print, and more.
  cv::rectangle(image, cv::Rect(0, 0, 318, 480), cv::Scalar::all(180), cv::FILLED);
  Vector6d off;
  off << 0.002, 0.001, 0.004, 0.01, 0.01, 0.005;
  const auto found = align(image, truth.retract(off));
  ASSERT_TRUE(found);
  // The corners of the hidden half are extrapolated.
  EXPECT_LT(cornerError_px(found->T_c_p, truth), 1.0);
  EXPECT_LT(found->agreeing_share, 0.65);
  EXPECT_GT(found->agreeing_share, 0.35);
  const Vector6d error = found->T_c_p.localCoordinates(truth);
  EXPECT_LT(error.dot(found->covariance.ldlt().solve(error)), 25.0);  // chi-square of 6: 99.97 %
}

TEST_F(PictureAlignmentTest, MotionBlurIsFitted) {
  const Transform truth = testing::pictureAt(0.7, 0.3, 2.0, 0.1);
  cv::Mat image = seen(truth);
  cv::blur(image, image, cv::Size(7, 1));  // 7 pixels to the side
  const auto found = align(image, truth);
  ASSERT_TRUE(found);
  EXPECT_GT(found->blur_px, 1.5);
  EXPECT_LT(found->blur_px, 2.6);  // a box of 7 pixels has 2
  EXPECT_LT(cornerError_px(found->T_c_p, truth), 0.15);
}

// The start has the picture in a notice's upper half where it is, and turned so that the lines of
// text below are each taken for another.
TEST(PictureAlignmentOfText, AFitThatSlippedByALineIsMended) {
  constexpr double kNotice_m = 0.21;
  const cv::Mat print = testing::notice(3);
  const NaturalMarker marker =
      NaturalMarker::create(testing::viewOf(print), kNotice_m, 0.0).value();
  const testing::PictureScene scene{.camera = CameraModel(testing::testCalibration())};
  PixelRays rays(scene.camera);
  const Transform truth = testing::pictureAt(0.7, 0.3, 1.0, 0.1);
  const cv::Mat image = testing::seenPicture(scene, print, kNotice_m, marker.height_m(), truth, 1);
  const GreyPyramid pyramid(testing::viewOf(image), 40);
  PictureAlignmentOptions as_fitted;
  as_fitted.rematch_share = 0.0;
  const Eigen::Vector3d stays(0.0, 0.3 * marker.height_m(), 0.0);
  int slipped = 0;
  for (const double turn_rad : {-0.5, -0.4, -0.3}) {
    for (const double roll_rad : {-0.05, 0.0}) {
      Transform turned;
      turned.R = expSo3({turn_rad, 0.25, roll_rad});
      turned.p = stays - turned.R * stays;
      const Transform start = truth * turned;
      const auto fitted = alignPicture(marker, pyramid, start, &rays, as_fitted);
      if (fitted && (fitted->T_c_p.p - truth.p).norm() > 0.001) ++slipped;
      const auto mended = alignPicture(marker, pyramid, start, &rays);
      if (!mended) continue;
      EXPECT_LT((mended->T_c_p.p - truth.p).norm(), 0.0005) << turn_rad << ' ' << roll_rad;
      EXPECT_GT(mended->agreeing_share, 0.95) << turn_rad << ' ' << roll_rad;
    }
  }
  EXPECT_GE(slipped, 3);
}

TEST_F(PictureAlignmentTest, AnotherPictureDoesNotAgree) {
  const Transform truth = testing::pictureAt(0.7, 0.4, 2.0, 0.1);
  const cv::Mat image =
      testing::seenPicture(scene_, testing::poster(8), kWidth_m, marker_.height_m(), truth, 1);
  const auto found = align(image, truth);
  EXPECT_TRUE(!found || found->agreeing_share < 0.3);
}

TEST_F(PictureAlignmentTest, NothingToSeeIsNoAlignment) {
  const cv::Mat image(480, 640, CV_8U, cv::Scalar(120));
  const auto blank = align(image, testing::pictureAt(0.7, 0.4, 2.0, 0.1));
  EXPECT_TRUE(!blank || blank->correlation == 0.0);
  // Behind the camera, seen from its back, too far away, beside the image.
  Transform T_c_p = testing::pictureAt(-0.7, 0.0, 0.0, 0.0);
  EXPECT_FALSE(align(image, T_c_p));
  T_c_p = testing::pictureAt(0.7, 3.0, 0.0, 0.0);
  EXPECT_FALSE(align(image, T_c_p));
  EXPECT_FALSE(align(image, testing::pictureAt(40.0, 0.0, 0.0, 0.0)));
  T_c_p = testing::pictureAt(0.7, 0.0, 0.0, 0.0);
  T_c_p.p.x() = 3.0;
  EXPECT_FALSE(align(image, T_c_p));
}

TEST_F(PictureAlignmentTest, TheMirroredPoseIsWorse) {
  const Transform truth = testing::pictureAt(1.2, 0.6, 0.5, 0.0);
  const cv::Mat image = seen(truth);
  const auto right = align(image, truth);
  ASSERT_TRUE(right);
  const auto other = mirroredPose(right->T_c_p, kWidth_m, scene_.camera.focalLength());
  ASSERT_TRUE(other);
  EXPECT_GT(rotationDistance(other->R, truth.R), 0.5);
  const auto mirrored = align(image, *other);
  ASSERT_TRUE(mirrored);
  if (rotationDistance(mirrored->T_c_p.R, truth.R) > 0.3) {
    EXPECT_GT(evidenceAgainst(*mirrored, *right), 20.0);
  }
}

// However many pixels speak for one of two poses: what would take the corners from the one to the
// other may be the lens, or the paper.
TEST(PictureAlignmentEvidence, NoNumberOfPixelsDecidesWhatASystematicErrorMayBe) {
  const CameraModel camera(testing::testCalibration());
  const NaturalMarker marker =
      NaturalMarker::create(testing::viewOf(testing::poster(7)), 0.2, 0.15).value();
  PictureAlignment best;
  best.pixels = 4000;
  best.noise = 0.5;
  best.cut_square = 0.25;
  best.systematic_px = 0.03;
  const auto evidence = [&](double turn_rad, double worse) {
    PictureAlignment rival = best;
    best.T_c_p = testing::pictureAt(2.0, 0.5 * turn_rad, 0.0, 0.0);
    rival.T_c_p = testing::pictureAt(2.0, -0.5 * turn_rad, 0.0, 0.0);
    rival.cut_square += worse;
    return std::pair(evidenceAgainst(rival, best),
                     evidenceAgainstPose(marker, camera, rival, best));
  };
  const auto [pixels, both] = evidence(0.02, 1.0);
  EXPECT_GT(pixels, 1000.0);
  EXPECT_LT(both, 0.1 * pixels);
  EXPECT_GT(both, 0.0);
  const auto [far_pixels, far_both] = evidence(0.8, 1.0);
  EXPECT_GT(far_pixels, 1000.0);
  EXPECT_GT(far_both, 1000.0) << "no lens makes that";
  EXPECT_EQ(evidence(0.02, 0.0).second, 0.0);
}

}  // namespace
}  // namespace waymark::slam
