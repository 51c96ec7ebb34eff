#include "slam/geometry/mean_transform.h"

#include <vector>

#include <Eigen/Eigenvalues>

namespace waymark::slam {

Eigen::Matrix3d meanRotation(std::span<const Eigen::Matrix3d> rotations) {
  // The largest eigenvector of the sum of q q^T: the sign of a quaternion does not matter to it.
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  for (const Eigen::Matrix3d& R : rotations) {
    const Eigen::Vector4d q = Eigen::Quaterniond(R).coeffs();
    sum += q * q.transpose();
  }
  // Of rotations that are much alike it is near each of them: some powers of the sum lead there.
  constexpr int kPowers = 20;
  constexpr double kThere = 1e-15;
  Eigen::Vector4d q = Eigen::Quaterniond(rotations.front()).coeffs();
  for (int i = 0; i < kPowers; ++i) {
    const Eigen::Vector4d next = (sum * q).normalized();
    const bool there = (next - q).squaredNorm() <= kThere * kThere;
    q = next;
    if (there) return Eigen::Quaterniond(q).toRotationMatrix();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> solver(sum);
  return Eigen::Quaterniond(solver.eigenvectors().col(3)).normalized().toRotationMatrix();
}

Transform meanTransform(std::span<const Transform> transforms) {
  std::vector<Eigen::Matrix3d> rotations;
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  for (const Transform& T : transforms) {
    rotations.push_back(T.R);
    p += T.p / static_cast<double>(transforms.size());
  }
  return {meanRotation(rotations), p};
}

}  // namespace waymark::slam
