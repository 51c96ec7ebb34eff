#include "tools/calibration/plane_homography.h"

#include <cmath>
#include <numbers>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace waymark::calibration {
namespace {

// Moves points to their centre and scales them to a mean distance of sqrt(2).
Eigen::Matrix3d normalization(std::span<const Eigen::Vector2d> points) {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& p : points) centre += p;
  centre /= static_cast<double>(points.size());
  double distance = 0.0;
  for (const Eigen::Vector2d& p : points) distance += (p - centre).norm();
  distance /= static_cast<double>(points.size());
  const double scale = distance > 0.0 ? std::numbers::sqrt2 / distance : 1.0;
  Eigen::Matrix3d T;
  T << scale, 0.0, -scale * centre.x(), 0.0, scale, -scale * centre.y(), 0.0, 0.0, 1.0;
  return T;
}

}  // namespace

std::optional<Eigen::Matrix3d> fitHomography(std::span<const Eigen::Vector2d> from,
                                             std::span<const Eigen::Vector2d> to) {
  using Vector9d = Eigen::Matrix<double, 9, 1>;
  constexpr double kDegenerate = 1e-9;  // second smallest eigenvalue by the largest
  if (from.size() < 4 || from.size() != to.size()) return std::nullopt;
  const Eigen::Matrix3d T_from = normalization(from);
  const Eigen::Matrix3d T_to = normalization(to);
  Eigen::Matrix<double, 9, 9> M = Eigen::Matrix<double, 9, 9>::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Eigen::Vector3d p = T_from * from[i].homogeneous();
    const Eigen::Vector3d q = T_to * to[i].homogeneous();
    Vector9d row = Vector9d::Zero();
    row.head<3>() = p;
    row.tail<3>() = -q.x() * p;
    M += row * row.transpose();
    row.setZero();
    row.segment<3>(3) = p;
    row.tail<3>() = -q.y() * p;
    M += row * row.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> eigen(M);
  if (!(eigen.eigenvalues()[1] > kDegenerate * eigen.eigenvalues()[8])) return std::nullopt;
  const Vector9d h = eigen.eigenvectors().col(0);
  Eigen::Matrix3d H;
  H.row(0) = h.head<3>();
  H.row(1) = h.segment<3>(3);
  H.row(2) = h.tail<3>();
  H = T_to.inverse() * H * T_from;
  return H / H.norm();
}

}  // namespace waymark::calibration
