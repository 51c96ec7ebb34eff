#include "tools/calibration/camera_solver.h"

#include <cmath>
#include <cstdio>
#include <random>

#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>

#include "slam/geometry/homography.h"
#include "slam/testing/synthetic.h"
#include "tools/calibration/board.h"
#include "tools/calibration/board_pose.h"
#include "tools/calibration/plane_homography.h"
#include "tools/calibration/projection_sigma.h"
#include "tools/calibration/testing/drawn_board.h"

namespace waymark::calibration {
namespace {

slam::Calibration fisheye() {
  slam::Calibration c{
      .width = 640, .height = 480, .fx = 260.0, .fy = 261.0, .cx = 322.0, .cy = 236.0};
  c.model = slam::DistortionModel::kEquidistant;
  c.distortion = {-0.02, 0.01, -0.004, 0.001};
  return c;
}

slam::Calibration wide() {
  slam::Calibration c = slam::testing::testCalibration();
  c.distortion = {0.4, 0.1, 3e-4, -2e-4, 0.01, 0.75, 0.2, 0.03};
  return c;
}

// The points of the board that a camera sees, with noise.
std::vector<std::vector<BoardPoint>> observed(const Board& board, const slam::CameraModel& camera,
                                              const std::vector<slam::Transform>& poses,
                                              double sigma_px, unsigned seed) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> noise(0.0, sigma_px);
  std::vector<std::vector<BoardPoint>> views;
  for (const slam::Transform& T_c_b : poses) {
    std::vector<BoardPoint> points;
    for (std::size_t i = 0; i < board.points().size(); ++i) {
      const auto pixel = camera.project(T_c_b * board.points()[i]);
      if (!pixel || !camera.inImage(*pixel)) continue;
      points.push_back({i, *pixel + Eigen::Vector2d(noise(rng), noise(rng)),
                        0.01 * Eigen::Matrix2d::Identity()});
    }
    if (points.size() >= 12) views.push_back(points);
  }
  return views;
}

TEST(PlaneHomography, FindsWhatMadeThePoints) {
  Eigen::Matrix3d H;
  H << 300.0, 20.0, 310.0, -15.0, 280.0, 250.0, 0.2, -0.3, 1.0;
  std::vector<Eigen::Vector2d> from;
  std::vector<Eigen::Vector2d> to;
  for (int i = 0; i < 9; ++i) {
    from.emplace_back(0.1 * (i % 3), 0.13 * (i / 3));
    to.push_back(slam::applyHomography(H, from.back()));
  }
  const auto found = fitHomography(from, to);
  ASSERT_TRUE(found);
  EXPECT_LT((*found / (*found)(2, 2) - H).norm(), 1e-6);
  for (Eigen::Vector2d& point : from) point.y() = 2.0 * point.x();
  for (std::size_t i = 0; i < from.size(); ++i) to[i] = slam::applyHomography(H, from[i]);
  EXPECT_FALSE(fitHomography(from, to));
  EXPECT_FALSE(fitHomography(std::span(from).first(3), std::span(to).first(3)));
}

TEST(BoardPose, ExactFromExactPoints) {
  const Board board{BoardOptions{}};
  const slam::CameraModel camera(slam::testing::testCalibration());
  for (const slam::Transform& T_c_b : testing::goodPoses(camera, 0.5, 12)) {
    const auto views = observed(board, camera, {T_c_b}, 0.0, 1);
    if (views.empty()) continue;
    const auto pose = boardPose(board.points(), views.front(), camera);
    ASSERT_TRUE(pose);
    EXPECT_LT(pose->rms_px, 1e-6);
    EXPECT_LT((pose->T_c_b.p - T_c_b.p).norm(), 1e-6);
    EXPECT_LT(slam::rotationDistance(pose->T_c_b.R, T_c_b.R), 1e-6);
  }
}

TEST(CameraSolver, JacobianIsTheDerivative) {
  for (const auto& [lens, calibration] :
       {std::pair{Lens::kPlumbBob, slam::testing::testCalibration()},
        {Lens::kRational, wide()},
        {Lens::kEquidistant, fisheye()}}) {
    const Eigen::Vector2d n(0.4, -0.3);
    const Eigen::VectorXd at = parametersOf(calibration, lens);
    const Eigen::Matrix2Xd J = parameterJacobian(slam::CameraModel(calibration), lens, n);
    ASSERT_EQ(J.cols(), at.size());
    for (Eigen::Index i = 0; i < at.size(); ++i) {
      const double step = i < 4 ? 1e-3 : 1e-6;
      const auto pixel = [&](double change) {
        Eigen::VectorXd changed = at;
        changed[i] += change;
        return slam::CameraModel(withParameters(calibration, lens, changed)).distort(n);
      };
      const Eigen::Vector2d numeric = (pixel(step) - pixel(-step)) / (2.0 * step);
      EXPECT_LT((J.col(i) - numeric).norm(), 1e-5 * (1.0 + numeric.norm()))
          << parameterNames(lens)[static_cast<std::size_t>(i)];
    }
  }
}

// Every parameter within four of its standard deviations, and those are what the noise says.
TEST(CameraSolver, RecoversTheTruth) {
  const Board board{BoardOptions{}};
  struct Case {
    Lens lens;
    slam::Calibration truth;
    double distance_m;
  };
  for (const Case& c :
       {Case{Lens::kPlumbBob, slam::testing::testCalibration(), 0.45},
        Case{Lens::kRational, wide(), 0.45}, Case{Lens::kEquidistant, fisheye(), 0.25}}) {
    const slam::CameraModel camera(c.truth);
    const auto views =
        observed(board, camera, testing::goodPoses(camera, c.distance_m, 30), 0.1, 3);
    ASSERT_GE(views.size(), 20U);
    const auto solution = solveCamera(board.points(), views, 640, 480, c.lens);
    ASSERT_TRUE(solution);
    EXPECT_NEAR(solution->noise, 1.0, 0.1);
    EXPECT_NEAR(solution->rms_px, 0.141, 0.01);
    const Eigen::VectorXd error =
        parametersOf(solution->camera, c.lens) - parametersOf(c.truth, c.lens);
    for (Eigen::Index i = 0; i < error.size(); ++i) {
      EXPECT_LT(std::abs(error[i]), 4.0 * solution->sigma(i))
          << parameterNames(c.lens)[static_cast<std::size_t>(i)];
    }
    EXPECT_LT(std::abs(error[0]) / c.truth.fx, 1e-3);
    EXPECT_LT(projectionSigma(*solution).worst_px, 1.0);
  }
}

// Over many calibrations, of many views and of few, the intrinsics are as wrong as the file will
// say. Beside a lens of more coefficients, those are where they are.
TEST(CameraSolver, TheMeasuredCameraIsAsWrongAsItSays) {
  constexpr int kRuns = 40;
  const Board board{BoardOptions{}};
  const slam::CameraModel camera(slam::testing::testCalibration());
  for (const int view_count : {6, 30}) {
    double nees = 0.0;
    for (int seed = 0; seed < kRuns; ++seed) {
      const auto views = observed(board, camera, testing::goodPoses(camera, 0.45, view_count), 0.1,
                                  static_cast<unsigned>(seed));
      const auto solution = solveCamera(board.points(), views, 640, 480, Lens::kPlumbBob);
      ASSERT_TRUE(solution) << seed;
      const slam::Calibration measured = solution->measuredCamera();
      ASSERT_TRUE(measured.covariance && measured.invalidReason().empty()) << seed;
      const slam::IntrinsicVector error =
          slam::CameraModel(measured).intrinsics() - camera.intrinsics();
      nees += error.dot(slam::informationOf(*measured.covariance) * error) / kRuns;
    }
    std::printf("%d views: NEES %.2f of 9\n", view_count, nees);
    EXPECT_LT(nees, 9.0 + 3.0 * std::sqrt(2.0 * 9.0 / kRuns)) << view_count;
    EXPECT_GT(nees, 9.0 - 4.0 * std::sqrt(2.0 * 9.0 / kRuns)) << view_count;
  }
  const auto views =
      observed(board, slam::CameraModel(wide()), testing::goodPoses(camera, 0.45, 30), 0.1, 3);
  const auto solution = solveCamera(board.points(), views, 640, 480, Lens::kRational);
  ASSERT_TRUE(solution);
  const slam::Calibration measured = solution->measuredCamera();
  ASSERT_TRUE(measured.covariance && measured.invalidReason().empty());
  EXPECT_LT((*measured.covariance)(4, 4), solution->joint_covariance(4, 4));
}

TEST(CameraSolver, AgreesWithOpenCv) {
  const Board board{BoardOptions{}};
  const slam::CameraModel camera(slam::testing::testCalibration());
  const auto views = observed(board, camera, testing::goodPoses(camera, 0.45, 20), 0.2, 9);
  std::vector<std::vector<cv::Point3f>> objects;
  std::vector<std::vector<cv::Point2f>> images;
  for (const auto& view : views) {
    objects.emplace_back();
    images.emplace_back();
    for (const BoardPoint& point : view) {
      const Eigen::Vector3f p = board.points()[point.index].cast<float>();
      objects.back().emplace_back(p.x(), p.y(), p.z());
      images.back().emplace_back(static_cast<float>(point.pixel.x()),
                                 static_cast<float>(point.pixel.y()));
    }
  }
  cv::Mat K, d;
  std::vector<cv::Mat> rotations, translations;
  const double rms =
      cv::calibrateCamera(objects, images, {640, 480}, K, d, rotations, translations);
  // Without the robust kernel both minimize the same.
  const auto solution =
      solveCamera(board.points(), views, 640, 480, Lens::kPlumbBob, {.huber_sigmas = 1e3});
  ASSERT_TRUE(solution);
  EXPECT_NEAR(solution->rms_px, rms, 1e-4);
  EXPECT_NEAR(solution->camera.fx, K.at<double>(0, 0), 0.01);
  EXPECT_NEAR(solution->camera.cy, K.at<double>(1, 2), 0.01);
  EXPECT_NEAR(solution->camera.distortion[0], d.at<double>(0), 1e-4);
}

// Boards parallel to the sensor say nothing of the focal length.
TEST(CameraSolver, WithoutTiltTheFocalLengthIsUnknown) {
  const Board board{BoardOptions{}};
  const slam::CameraModel camera(slam::testing::testCalibration());
  std::vector<slam::Transform> poses;
  for (int i = 0; i < 12; ++i) {
    poses.push_back(testing::boardAt(camera, {150.0 + 110.0 * (i % 4), 120.0 + 110.0 * (i / 4)},
                                     0.5, 0.0, 0.0, 0.1 * i));
  }
  const auto views = observed(board, camera, poses, 0.1, 4);
  const auto solution = solveCamera(board.points(), views, 640, 480, Lens::kPlumbBob);
  EXPECT_TRUE(!solution || !(solution->sigma(0) / solution->camera.fx < 0.005));
  EXPECT_FALSE(solveCamera(board.points(), std::span(views).first(2), 640, 480, Lens::kPlumbBob));
}

// The centre of a long lens may be anywhere: the camera is only turned a little then.
TEST(ProjectionSigma, TurningTheCameraDoesNoHarm) {
  Solution solution;
  solution.camera = roughCalibration(640, 480);
  solution.camera.fx = solution.camera.fy = 6000.0;
  solution.covariance = Eigen::MatrixXd::Zero(9, 9);
  solution.covariance(2, 2) = 25.0;  // cx
  EXPECT_LT(projectionSigma(solution).worst_px, 0.05);
  solution.covariance.setZero();
  solution.covariance(0, 0) = solution.covariance(1, 1) = 3600.0;  // 1 % of fx and fy
  // At the border 3.2 pixels in x, at the corners 2.4 in y: none of it is a rotation.
  EXPECT_NEAR(projectionSigma(solution).worst_px, std::sqrt(0.5 * (3.2 * 3.2 + 2.4 * 2.4)), 0.1);
  EXPECT_EQ(projectionSigma(solution).invertible, 1.0);
}

}  // namespace
}  // namespace waymark::calibration
