#include "slam/tracking/motion_model.h"

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

constexpr std::int64_t kMs = 1'000'000;

// Constant velocity in the camera frame: every step the same rigid motion.
TEST(MotionModel, PredictsConstantMotion) {
  MotionModel model;
  EXPECT_FALSE(model.predict(0));
  const Transform step{expSo3({0.01, 0.02, -0.01}), {0.01, 0.0, 0.02}};
  Transform T;
  for (int i = 0; i < 5; ++i) {
    model.update(T, i * 10 * kMs);
    T = T * step;
  }
  const auto next = model.predict(50 * kMs);
  ASSERT_TRUE(next);
  EXPECT_LT((next->p - T.p).norm(), 1e-9);
  EXPECT_LT(rotationDistance(next->R, T.R), 1e-7);
}

TEST(MotionModel, ForgetsWithTime) {
  MotionModel model;
  model.update(Transform{}, 0);
  Transform moved;
  moved.p.x() = 0.1;
  model.update(moved, 10 * kMs);
  EXPECT_NEAR(model.predict(20 * kMs)->p.x(), 0.2, 1e-12);
  EXPECT_NEAR(model.predict(510 * kMs)->p.x(), 0.1, 1e-12) << "too long to extrapolate";
  EXPECT_FALSE(model.predict(2000 * kMs)) << "too old to be a prior";
  EXPECT_FALSE(model.predict(0)) << "time does not run backwards";
}

TEST(MotionModel, ACorrectionIsNotMotion) {
  MotionModel model;
  model.update(Transform{}, 0);
  model.update(Transform{}, 10 * kMs);
  Transform corrected;
  corrected.p.y() = 0.5;
  model.correct(corrected);
  EXPECT_NEAR(model.predict(20 * kMs)->p.y(), 0.5, 1e-12);
}

}  // namespace
}  // namespace waymark::slam
