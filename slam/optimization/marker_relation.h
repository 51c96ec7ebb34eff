// The residual of a BundleProblem::Relation: R_w_f^T (R_w_m a + [p_m - p_f]) - b, weighted axis by
// axis of the frame; a is the marker's vector, b where the frame has it, and what is in brackets
// goes in for points. It depends on the marker's pose in the frame alone: its derivative by the
// frame is that of a rigid body, -J K (transposedTransport).
#pragma once

#include <span>

#include "slam/optimization/bundle_problem.h"

namespace waymark::slam {

// In sigmas.
[[nodiscard]] Eigen::Vector3d relationResidual(const BundleProblem::Relation& relation,
                                               const Transform& T_w_f, const Transform& T_w_m);
// By (dp, dtheta) of the marker, in the world.
[[nodiscard]] Eigen::Matrix<double, 3, 6> relationJacobian(const BundleProblem::Relation& relation,
                                                           const Transform& T_w_f,
                                                           const Transform& T_w_m);

// What the relations say of the marker's pose, and of the frame's the other way round; weighted
// with Huber's kernel.
struct RelationSums {
  Matrix6d H = Matrix6d::Zero();  // J^T J
  Vector6d g = Vector6d::Zero();  // J^T residual
  double cost = 0.0;              // as relationCost()
};
[[nodiscard]] RelationSums sumRelations(std::span<const BundleProblem::Relation> relations,
                                        const Transform& T_w_f, const Transform& T_w_m,
                                        double huber);
[[nodiscard]] double relationCost(std::span<const BundleProblem::Relation> relations,
                                  const Transform& T_w_f, const Transform& T_w_m, double huber);

}  // namespace waymark::slam
