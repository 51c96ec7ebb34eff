#include "slam/optimization/marker_relation.h"

#include "slam/geometry/robust.h"

namespace waymark::slam {

Eigen::Vector3d relationResidual(const BundleProblem::Relation& relation, const Transform& T_w_f,
                                 const Transform& T_w_m) {
  Eigen::Vector3d vector = T_w_m.R * relation.in_marker;
  if (relation.is_point) vector += T_w_m.p - T_w_f.p;
  return relation.weight.cwiseProduct(T_w_f.R.transpose() * vector - relation.in_frame);
}

Eigen::Matrix<double, 3, 6> relationJacobian(const BundleProblem::Relation& relation,
                                             const Transform& T_w_f, const Transform& T_w_m) {
  const Eigen::Matrix3d W = relation.weight.asDiagonal() * T_w_f.R.transpose();
  Eigen::Matrix<double, 3, 6> J;
  J.leftCols<3>() = relation.is_point ? W : Eigen::Matrix3d(Eigen::Matrix3d::Zero());
  J.rightCols<3>() = -W * skew(T_w_m.R * relation.in_marker);
  return J;
}

RelationSums sumRelations(std::span<const BundleProblem::Relation> relations,
                          const Transform& T_w_f, const Transform& T_w_m, double huber) {
  RelationSums sums;
  for (const BundleProblem::Relation& relation : relations) {
    const Eigen::Vector3d residual = relationResidual(relation, T_w_f, T_w_m);
    const Eigen::Matrix<double, 3, 6> J = relationJacobian(relation, T_w_f, T_w_m);
    const double weight = huberWeight(residual.squaredNorm(), huber);
    sums.H += weight * J.transpose() * J;
    sums.g += weight * J.transpose() * residual;
    sums.cost += huberCost(residual.squaredNorm(), huber);
  }
  return sums;
}

double relationCost(std::span<const BundleProblem::Relation> relations, const Transform& T_w_f,
                    const Transform& T_w_m, double huber) {
  double cost = 0.0;
  for (const BundleProblem::Relation& relation : relations) {
    cost += huberCost(relationResidual(relation, T_w_f, T_w_m).squaredNorm(), huber);
  }
  return cost;
}

}  // namespace waymark::slam
