#include "slam/optimization/marker_relation.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/optimization/block_kernels.h"
#include "slam/testing/scene.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

using Relation = BundleProblem::Relation;
constexpr double kWideKernel = 1e9;

Relation anyRelation(bool is_point) {
  return {.in_marker = {0.1, -0.2, 0.3},
          .is_point = is_point,
          .in_frame = {0.4, 0.1, -0.2},
          .weight = {100.0, 0.0, 30.0}};
}

class MarkerRelationTest : public ::testing::TestWithParam<bool> {
 protected:
  std::mt19937 rng_{4};
  Transform T_w_f_ = testing::disturbed(Transform{}, 0.8, &rng_);
  Transform T_w_m_ = testing::disturbed(Transform{}, 0.8, &rng_);
  Relation relation_ = anyRelation(GetParam());
};

TEST_P(MarkerRelationTest, TheJacobiansMatchFiniteDifferences) {
  constexpr double kStep = 1e-6;
  const auto J = relationJacobian(relation_, T_w_f_, T_w_m_);
  const Matrix6d transport =
      transposedTransport<6>(T_w_m_.p - T_w_f_.p, Matrix6d::Identity()).transpose();
  const Eigen::Matrix<double, 3, 6> J_frame = -J * transport;
  for (int i = 0; i < 6; ++i) {
    const Vector6d step = kStep * Vector6d::Unit(i);
    const Eigen::Vector3d by_marker = (relationResidual(relation_, T_w_f_, T_w_m_.retract(step)) -
                                       relationResidual(relation_, T_w_f_, T_w_m_.retract(-step))) /
                                      (2.0 * kStep);
    const Eigen::Vector3d by_frame = (relationResidual(relation_, T_w_f_.retract(step), T_w_m_) -
                                      relationResidual(relation_, T_w_f_.retract(-step), T_w_m_)) /
                                     (2.0 * kStep);
    EXPECT_LT((J.col(i) - by_marker).norm(), 1e-6 * J.norm()) << i;
    EXPECT_LT((J_frame.col(i) - by_frame).norm(), 1e-6 * J_frame.norm()) << i;
  }
}

TEST_P(MarkerRelationTest, TheSumsAreThoseOfTheJacobian) {
  const auto J = relationJacobian(relation_, T_w_f_, T_w_m_);
  const Eigen::Vector3d residual = relationResidual(relation_, T_w_f_, T_w_m_);
  const RelationSums sums = sumRelations({&relation_, 1}, T_w_f_, T_w_m_, kWideKernel);
  EXPECT_LT((sums.H - J.transpose() * J).norm(), 1e-9 * sums.H.norm());
  EXPECT_LT((sums.g - J.transpose() * residual).norm(), 1e-9 * sums.g.norm());
  EXPECT_DOUBLE_EQ(relationCost({&relation_, 1}, T_w_f_, T_w_m_, kWideKernel),
                   residual.squaredNorm());
  const RelationSums robust = sumRelations({&relation_, 1}, T_w_f_, T_w_m_, 1.0);
  EXPECT_LT(robust.g.norm(), 0.5 * sums.g.norm()) << "the kernel bounds its pull";
}

TEST_P(MarkerRelationTest, WhereItHoldsItIsZero) {
  Relation holds = relation_;
  holds.in_frame = T_w_f_.R.transpose() * (T_w_m_.R * relation_.in_marker);
  if (GetParam()) holds.in_frame = T_w_f_.inverse() * (T_w_m_ * relation_.in_marker);
  EXPECT_LT(relationResidual(holds, T_w_f_, T_w_m_).norm(), 1e-10);
}

INSTANTIATE_TEST_SUITE_P(OfPointsAndDirections, MarkerRelationTest, ::testing::Bool());

}  // namespace
}  // namespace waymark::slam
