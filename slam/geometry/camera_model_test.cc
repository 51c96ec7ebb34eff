#include "slam/geometry/camera_model.h"

#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>

namespace waymark::slam {
namespace {

Calibration plumbBob() {
  Calibration c{.width = 640, .height = 480, .fx = 652.87, .fy = 650.87, .cx = 347.6, .cy = 199.3};
  c.distortion = {-0.4357, 0.2757, 1.475e-4, -1.095e-3, -0.13};
  return c;
}

Calibration rational() {
  Calibration c{.width = 1280, .height = 720, .fx = 700, .fy = 702, .cx = 640, .cy = 355};
  c.distortion = {0.6, 0.1, -3e-4, 2e-4, 0.01, 0.9, 0.2, 0.03};
  return c;
}

Calibration equidistant() {
  Calibration c{.width = 1280, .height = 1024, .fx = 465.6, .fy = 465.6, .cx = 622.6, .cy = 513.9};
  c.model = DistortionModel::kEquidistant;
  c.distortion = {-0.02295, 0.01625, -0.009618, 0.0017623};
  return c;
}

std::vector<Calibration> all() { return {plumbBob(), rational(), equidistant()}; }

TEST(CameraModel, ProjectsAsOpenCvDoes) {
  for (const Calibration& c : all()) {
    const CameraModel camera(c);
    const cv::Matx33d K(c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1);
    for (int column = -4; column <= 4; ++column) {
      for (int row = -3; row <= 3; ++row) {
        const double x = 0.1 * column;
        const double y = 0.1 * row;
        const std::vector<cv::Point3d> points{{2 * x, 2 * y, 2.0}};
        std::vector<cv::Point2d> pixels;
        if (c.model == DistortionModel::kEquidistant) {
          cv::fisheye::projectPoints(points, pixels, cv::Vec3d(), cv::Vec3d(), K,
                                     cv::Vec4d(c.distortion.data()));
        } else {
          const std::vector<double> d(c.distortion.begin(), c.distortion.end());
          cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), K, d, pixels);
        }
        const auto ours = camera.project({2 * x, 2 * y, 2.0});
        ASSERT_TRUE(ours);
        EXPECT_NEAR(ours->x(), pixels[0].x, 1e-8);
        EXPECT_NEAR(ours->y(), pixels[0].y, 1e-8);
      }
    }
  }
}

TEST(CameraModel, UndistortInvertsDistortOverTheWholeImage) {
  for (const Calibration& c : all()) {
    const CameraModel camera(c);
    int inverted = 0;
    int tried = 0;
    for (int y = 0; y < c.height; y += 20) {
      for (int x = 0; x < c.width; x += 20) {
        const Eigen::Vector2d pixel(x, y);
        // A fisheye's corners look beyond 90 degrees, where there is no image plane.
        if (std::hypot((x - c.cx) / c.fx, (y - c.cy) / c.fy) > 1.35) continue;
        ++tried;
        const auto n = camera.undistort(pixel);
        if (!n) continue;
        ++inverted;
        EXPECT_LT((camera.distort(*n) - pixel).norm(), 1e-7) << pixel.transpose();
      }
    }
    EXPECT_EQ(inverted, tried);
  }
}

TEST(CameraModel, JacobianMatchesFiniteDifferences) {
  constexpr double kStep = 1e-6;
  for (const Calibration& c : all()) {
    const CameraModel camera(c);
    for (const Eigen::Vector2d& n : {Eigen::Vector2d(0.0, 0.0), Eigen::Vector2d(1e-7, 0.0),
                                     Eigen::Vector2d(0.2, -0.3), Eigen::Vector2d(-0.35, 0.1)}) {
      Eigen::Matrix2d J;
      (void)camera.distort(n, &J);
      for (int k = 0; k < 2; ++k) {
        Eigen::Vector2d step = Eigen::Vector2d::Zero();
        step[k] = kStep;
        const Eigen::Vector2d numeric =
            (camera.distort(n + step) - camera.distort(n - step)) / (2.0 * kStep);
        EXPECT_LT((numeric - J.col(k)).norm(), 1e-4 * c.fx);
      }
    }
  }
}

TEST(CameraModel, IntrinsicJacobianMatchesFiniteDifferences) {
  for (const Calibration& c : all()) {
    const CameraModel camera(c);
    const IntrinsicVector v = camera.intrinsics();
    const Calibration same = camera.withIntrinsics(v);
    EXPECT_EQ(same.fx, c.fx);
    EXPECT_EQ(same.distortion, c.distortion);
    for (const Eigen::Vector2d& n :
         {Eigen::Vector2d(0.0, 0.0), Eigen::Vector2d(0.2, -0.3), Eigen::Vector2d(-0.35, 0.1)}) {
      const IntrinsicJacobian J = camera.intrinsicJacobian(n);
      for (Eigen::Index k = 0; k < v.size(); ++k) {
        const double h = k < 4 ? 1e-3 : 1e-6;
        IntrinsicVector plus = v;
        IntrinsicVector minus = v;
        plus[k] += h;
        minus[k] -= h;
        const Eigen::Vector2d numeric = (CameraModel(camera.withIntrinsics(plus)).distort(n) -
                                         CameraModel(camera.withIntrinsics(minus)).distort(n)) /
                                        (2.0 * h);
        EXPECT_LT((numeric - J.col(k)).norm(), 1e-5 * c.fx) << "parameter " << k;
      }
    }
  }
}

TEST(CameraModel, HasNoAnswerBehindTheCameraOrOutsideTheLens) {
  const CameraModel camera(plumbBob());
  EXPECT_FALSE(camera.project({0.0, 0.0, -1.0}));
  EXPECT_FALSE(camera.project({0.0, 0.0, 0.0}));
  EXPECT_FALSE(camera.undistort({5000.0, 5000.0}));
}

TEST(Calibration, SaysWhyItIsInvalid) {
  EXPECT_EQ(plumbBob().invalidReason(), "");
  Calibration c = plumbBob();
  c.fx = -1.0;
  EXPECT_NE(c.invalidReason(), "");
  c = plumbBob();
  c.width = 0;
  EXPECT_NE(c.invalidReason(), "");
  c = plumbBob();
  c.distortion[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(c.invalidReason(), "");
  c = plumbBob();
  c.cx = 10000.0;
  EXPECT_NE(c.invalidReason(), "");
  c = plumbBob();
  c.fy = 1e-9;
  EXPECT_EQ(c.invalidReason(), "focal lengths must be from 0.001 to 1e9 pixels");
  c = plumbBob();
  c.distortion[4] = -1e10;
  EXPECT_EQ(c.invalidReason(), "distortion has a value beyond 1e9");
}

}  // namespace
}  // namespace waymark::slam
