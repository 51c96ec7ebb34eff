#include "slam/natural/filter/point_view.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/natural/filter/se3.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

// d f / d xi of T = Exp(xi) T_0.
template <typename F>
Matrix26d numericByMotion(const Transform& T, const F& f) {
  Matrix26d J;
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 6; ++i) {
    const Vector6d xi = kStep * Vector6d::Unit(i);
    J.col(i) = (f(expSe3(xi) * T) - f(expSe3(Vector6d(-xi)) * T)) / (2.0 * kStep);
  }
  return J;
}

struct Scene {
  explicit Scene(unsigned seed) {
    std::mt19937 rng(seed);
    std::uniform_real_distribution<double> u(-1.0, 1.0);
    T_w_a = testing::lookAt({5.0 + u(rng), u(rng), u(rng)}, {5.0 + 0.3 * u(rng), 4.0, u(rng)});
    T_w_c = T_w_a.retract((Vector6d() << 0.3 * u(rng), 0.3 * u(rng), 0.3 * u(rng), 0.2 * u(rng),
                           0.2 * u(rng), 0.2 * u(rng))
                              .finished());
    feature.uv = {0.3 * u(rng), 0.25 * u(rng)};
    feature.rho = 0.4 + 0.3 * u(rng);
  }
  CameraModel camera{testing::testCalibration()};
  Transform T_w_a, T_w_c;
  StateFeature feature;
};

TEST(PointView, IsTheProjectionOfThePoint) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Scene s(seed);
    PointView view;
    ASSERT_TRUE(viewFeature(s.camera, s.T_w_c, s.T_w_a, s.feature, &view));
    const Eigen::Vector3d p_a =
        Eigen::Vector3d(s.feature.uv.x(), s.feature.uv.y(), 1.0) / s.feature.rho;
    const auto pixel = s.camera.project(s.T_w_c.inverse() * (s.T_w_a * p_a));
    ASSERT_TRUE(pixel);
    EXPECT_LT((view.at - *pixel).norm(), 1e-9);
  }
}

TEST(PointView, JacobiansOfFeatures) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Scene s(seed);
    const auto at = [&s](const Transform& T_w_c, const Transform& T_w_a, const StateFeature& f) {
      PointView view;
      EXPECT_TRUE(viewFeature(s.camera, T_w_c, T_w_a, f, &view));
      return view.at;
    };
    PointView view;
    ASSERT_TRUE(viewFeature(s.camera, s.T_w_c, s.T_w_a, s.feature, &view));
    const Matrix26d by_anchor =
        numericByMotion(s.T_w_a, [&](const Transform& T) { return at(s.T_w_c, T, s.feature); });
    const Matrix26d by_camera =
        numericByMotion(s.T_w_c, [&](const Transform& T) { return at(T, s.T_w_a, s.feature); });
    EXPECT_LT((view.J_pose - by_anchor).norm(), 1e-6 * by_anchor.norm());
    EXPECT_LT((view.J_pose + by_camera).norm(), 1e-6 * by_camera.norm());
    constexpr double kStep = 1e-6;
    Matrix23d by_feature;
    for (int i = 0; i < 3; ++i) {
      StateFeature more = s.feature;
      StateFeature less = s.feature;
      (i < 2 ? more.uv[i] : more.rho) += kStep;
      (i < 2 ? less.uv[i] : less.rho) -= kStep;
      by_feature.col(i) = (at(s.T_w_c, s.T_w_a, more) - at(s.T_w_c, s.T_w_a, less)) / (2.0 * kStep);
    }
    EXPECT_LT((view.J_feature - by_feature).norm(), 1e-6 * by_feature.norm());
  }
}

TEST(PointView, DepthIsThatInTheCameraWithJacobians) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Scene s(seed);
    const auto depth = [](const Transform& T_w_c, const Transform& T_w_a, const StateFeature& f) {
      const auto view = viewDepth(T_w_c, T_w_a, f);
      EXPECT_TRUE(view);
      return view ? view->rho : 0.0;
    };
    const auto view = viewDepth(s.T_w_c, s.T_w_a, s.feature);
    ASSERT_TRUE(view);
    const Eigen::Vector3d p_w =
        s.T_w_a * (Eigen::Vector3d(s.feature.uv.x(), s.feature.uv.y(), 1.0) / s.feature.rho);
    EXPECT_NEAR(1.0 / view->rho, (s.T_w_c.inverse() * p_w).z(), 1e-9);

    constexpr double kStep = 1e-6;
    for (int i = 0; i < 6; ++i) {
      Vector6d xi = Vector6d::Zero();
      xi[i] = kStep;
      const auto slope = [&](const auto& at) {
        return (at(expSe3(xi)) - at(expSe3(-xi))) / (2.0 * kStep);
      };
      const double by_anchor =
          slope([&](const Transform& X) { return depth(s.T_w_c, X * s.T_w_a, s.feature); });
      const double by_camera =
          slope([&](const Transform& X) { return depth(X * s.T_w_c, s.T_w_a, s.feature); });
      EXPECT_NEAR(view->J_pose[i], by_anchor, 1e-7);
      EXPECT_NEAR(-view->J_pose[i], by_camera, 1e-7);
    }
    for (int i = 0; i < 3; ++i) {
      StateFeature more = s.feature;
      StateFeature less = s.feature;
      (i < 2 ? more.uv[i] : more.rho) += kStep;
      (i < 2 ? less.uv[i] : less.rho) -= kStep;
      EXPECT_NEAR(view->J_feature[i],
                  (depth(s.T_w_c, s.T_w_a, more) - depth(s.T_w_c, s.T_w_a, less)) / (2.0 * kStep),
                  1e-7);
    }
  }
}

TEST(PointView, JacobiansOfPoints) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Scene s(seed);
    const Eigen::Vector3d p_s(0.1, -0.2, 2.0 + 0.1 * seed);
    const auto at = [&p_s](const Transform& T_w_c, const Transform& T_w_s) {
      PointView view;
      EXPECT_TRUE(viewPoint(T_w_c, T_w_s, p_s, &view));
      return view.at;
    };
    PointView view;
    ASSERT_TRUE(viewPoint(s.T_w_c, s.T_w_a, p_s, &view));
    const Matrix26d by_pose =
        numericByMotion(s.T_w_a, [&](const Transform& T) { return at(s.T_w_c, T); });
    const Matrix26d by_camera =
        numericByMotion(s.T_w_c, [&](const Transform& T) { return at(T, s.T_w_a); });
    EXPECT_LT((view.J_pose - by_pose).norm(), 1e-6 * by_pose.norm());
    EXPECT_LT((view.J_pose + by_camera).norm(), 1e-6 * by_camera.norm());
  }
}

TEST(PointView, BehindTheCameraIsNotSeen) {
  Scene s(1);
  PointView view;
  s.T_w_c.R.col(0) *= -1.0;
  s.T_w_c.R.col(2) *= -1.0;
  EXPECT_FALSE(viewFeature(s.camera, s.T_w_c, s.T_w_a, s.feature, &view));
  EXPECT_FALSE(viewPoint(s.T_w_c, s.T_w_a, {0.0, 0.0, 2.0}, &view));
}

TEST(PointView, InfinitelyFarIsSeen) {
  Scene s(2);
  s.feature.rho = 0.0;
  PointView view;
  ASSERT_TRUE(viewFeature(s.camera, s.T_w_c, s.T_w_a, s.feature, &view));
  EXPECT_TRUE(view.at.allFinite());
  EXPECT_TRUE(view.J_feature.allFinite());
}

}  // namespace
}  // namespace waymark::slam
