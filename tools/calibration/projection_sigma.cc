#include "tools/calibration/projection_sigma.h"

#include <cmath>
#include <vector>

#include <Eigen/Cholesky>

namespace waymark::calibration {
namespace {

constexpr int kColumns = 13;
constexpr int kRows = 9;

// d pixel / d small rotation of the camera.
Eigen::Matrix<double, 2, 3> rotationJacobian(const slam::CameraModel& camera,
                                             const Eigen::Vector2d& normalized) {
  Eigen::Matrix2d D;
  (void)camera.distort(normalized, &D);
  Eigen::Matrix<double, 2, 3> J_point;
  J_point << 1.0, 0.0, -normalized.x(), 0.0, 1.0, -normalized.y();
  return -D * J_point * slam::skew(normalized.homogeneous());
}

}  // namespace

ProjectionSigma projectionSigma(const Solution& solution) {
  const slam::CameraModel camera(solution.camera);
  std::vector<Eigen::Vector2d> pixels;
  std::vector<Eigen::Vector2d> directions;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const Eigen::Vector2d pixel(column * (camera.width() - 1.0) / (kColumns - 1),
                                  row * (camera.height() - 1.0) / (kRows - 1));
      const auto normalized = camera.undistort(pixel);
      if (!normalized) continue;
      pixels.push_back(pixel);
      directions.push_back(*normalized);
    }
  }
  ProjectionSigma result;
  result.invertible = static_cast<double>(pixels.size()) / (kColumns * kRows);
  if (pixels.empty()) return result;

  const auto count = static_cast<Eigen::Index>(pixels.size());
  Eigen::MatrixXd J(2 * count, solution.covariance.rows());
  Eigen::MatrixX3d R(2 * count, 3);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector2d& direction = directions[static_cast<std::size_t>(i)];
    J.middleRows<2>(2 * i) = parameterJacobian(camera, solution.lens, direction);
    R.middleRows<2>(2 * i) = rotationJacobian(camera, direction);
  }
  J -= R * (R.transpose() * R).ldlt().solve(R.transpose() * J);
  double sum = 0.0;
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Matrix2d covariance =
        J.middleRows<2>(2 * i) * solution.covariance * J.middleRows<2>(2 * i).transpose();
    const double sigma_px = std::sqrt(0.5 * covariance.trace());
    sum += sigma_px;
    if (sigma_px <= result.worst_px) continue;
    result.worst_px = sigma_px;
    result.worst_at = pixels[static_cast<std::size_t>(i)];
  }
  result.mean_px = sum / static_cast<double>(count);
  return result;
}

}  // namespace waymark::calibration
