#include "slam/geometry/camera_model.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/LU>

namespace waymark::slam {
namespace {

// Beyond this radius (84 degrees off axis) a normalized coordinate is of no use.
constexpr double kLargestRadius = 10.0;

struct Radial {
  double factor;      // distorted = factor * undistorted (+ tangential)
  double derivative;  // d factor / d (r^2)
};

Radial rationalFactor(const std::array<double, 8>& d, double r2) {
  const double num = 1.0 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
  const double den = 1.0 + r2 * (d[5] + r2 * (d[6] + r2 * d[7]));
  const double dnum = d[0] + r2 * (2.0 * d[1] + r2 * 3.0 * d[4]);
  const double dden = d[5] + r2 * (2.0 * d[6] + r2 * 3.0 * d[7]);
  return {num / den, (dnum * den - num * dden) / (den * den)};
}

// theta_d = theta * (1 + k1 theta^2 + ...), and its derivative by theta.
std::pair<double, double> equidistantAngle(const std::array<double, 8>& d, double theta) {
  const double t2 = theta * theta;
  const double value = theta * (1.0 + t2 * (d[0] + t2 * (d[1] + t2 * (d[2] + t2 * d[3]))));
  const double slope =
      1.0 + t2 * (3.0 * d[0] + t2 * (5.0 * d[1] + t2 * (7.0 * d[2] + t2 * 9.0 * d[3])));
  return {value, slope};
}

Radial equidistantFactor(const std::array<double, 8>& d, double r2) {
  const double r = std::sqrt(r2);
  if (r < 1e-6) {
    // theta / r = 1 - r^2 / 3 + ..., times (1 + k1 r^2 + ...)
    return {1.0 + (d[0] - 1.0 / 3.0) * r2, d[0] - 1.0 / 3.0};
  }
  const auto [theta_d, slope] = equidistantAngle(d, std::atan(r));
  const double dtheta_dr = 1.0 / (1.0 + r2);
  const double dfactor_dr = (slope * dtheta_dr * r - theta_d) / r2;
  return {theta_d / r, dfactor_dr / (2.0 * r)};
}

Radial radialFactor(const Calibration& c, double r2) {
  return c.model == DistortionModel::kEquidistant ? equidistantFactor(c.distortion, r2)
                                                  : rationalFactor(c.distortion, r2);
}

// The radius up to which r -> r * factor(r) rises, found by walking outwards.
double monotonicRadius(const Calibration& c) {
  constexpr double kStep = 0.01;
  for (int steps = 1; steps * kStep < kLargestRadius; ++steps) {
    const double r = steps * kStep;
    const Radial f = radialFactor(c, r * r);
    const double slope = f.factor + 2.0 * r * r * f.derivative;
    if (!(slope > 0.0) || !(f.factor > 0.0)) return (steps - 1) * kStep;
  }
  return kLargestRadius;
}

// Symmetric, and positive definite where it is not zero, as for what is exact.
bool isCovariance(const IntrinsicMatrix& P) {
  if (!P.allFinite() || (P.diagonal().array() < 0.0).any()) return false;
  const IntrinsicVector sigmas = P.diagonal().cwiseSqrt();
  IntrinsicMatrix correlation = IntrinsicMatrix::Identity();
  for (Eigen::Index i = 0; i < P.rows(); ++i) {
    for (Eigen::Index j = 0; j < P.cols(); ++j) {
      if (i == j) continue;
      const double unit = sigmas[i] * sigmas[j];
      if (unit == 0.0 && P(i, j) != 0.0) return false;
      correlation(i, j) = unit == 0.0 ? 0.0 : P(i, j) / unit;
    }
  }
  constexpr double kRounding = 1e-9;
  return (correlation - correlation.transpose()).cwiseAbs().maxCoeff() < kRounding &&
         correlation.llt().info() == Eigen::Success;
}

}  // namespace

IntrinsicMatrix informationOf(IntrinsicMatrix covariance) {
  covariance.diagonal() = covariance.diagonal().cwiseMax(1.0 / kExactInformation);
  return covariance.ldlt().solve(IntrinsicMatrix::Identity());
}

std::string Calibration::invalidReason() const {
  if (width <= 0 || height <= 0) return "image size must be positive";
  for (const double v : {fx, fy, cx, cy}) {
    if (!std::isfinite(v)) return "camera matrix has a value that is not finite";
  }
  for (const double v : distortion) {
    if (!std::isfinite(v)) return "distortion has a value that is not finite";
  }
  if (fx <= 0.0 || fy <= 0.0) return "focal lengths must be positive";
  // Far from any lens, and little enough that what is reckoned with them still are numbers.
  constexpr double kShortest_px = 1e-3;
  constexpr double kLongest_px = 1e9;
  constexpr double kLargestCoefficient = 1e9;
  if (std::min(fx, fy) < kShortest_px || std::max(fx, fy) > kLongest_px) {
    return "focal lengths must be from 0.001 to 1e9 pixels";
  }
  for (const double v : distortion) {
    if (std::abs(v) > kLargestCoefficient) return "distortion has a value beyond 1e9";
  }
  if (cx < 0.0 || cy < 0.0 || cx >= width || cy >= height) {
    return "principal point lies outside the image";
  }
  if (covariance && !isCovariance(*covariance)) {
    return "the covariance of the intrinsics is not symmetric and positive";
  }
  return {};
}

CameraModel::CameraModel(const Calibration& calibration)
    : c_(calibration),
      focal_(std::sqrt(calibration.fx * calibration.fy)),
      max_radius_(monotonicRadius(calibration)) {}

Eigen::Vector2d CameraModel::distort(const Eigen::Vector2d& normalized,
                                     Eigen::Matrix2d* jacobian) const {
  const double x = normalized.x();
  const double y = normalized.y();
  const double r2 = x * x + y * y;
  const Radial f = radialFactor(c_, r2);
  const bool tangential = c_.model == DistortionModel::kRational;
  const double p1 = tangential ? c_.distortion[2] : 0.0;
  const double p2 = tangential ? c_.distortion[3] : 0.0;
  const double xd = x * f.factor + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
  const double yd = y * f.factor + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
  if (jacobian != nullptr) {
    const double cross = 2.0 * x * y * f.derivative + 2.0 * p1 * x + 2.0 * p2 * y;
    const double dxx = f.factor + 2.0 * x * x * f.derivative + 2.0 * p1 * y + 6.0 * p2 * x;
    const double dyy = f.factor + 2.0 * y * y * f.derivative + 6.0 * p1 * y + 2.0 * p2 * x;
    *jacobian << c_.fx * dxx, c_.fx * cross, c_.fy * cross, c_.fy * dyy;
  }
  return {c_.fx * xd + c_.cx, c_.fy * yd + c_.cy};
}

IntrinsicVector CameraModel::intrinsics() const {
  const std::array<double, 8>& d = c_.distortion;
  const bool fisheye = c_.model == DistortionModel::kEquidistant;
  IntrinsicVector v;
  v << c_.fx, c_.fy, c_.cx, c_.cy, d[0], d[1], d[2], d[3], fisheye ? 0.0 : d[4];
  return v;
}

Calibration CameraModel::withIntrinsics(const IntrinsicVector& v) const {
  Calibration c = c_;
  c.fx = v[0];
  c.fy = v[1];
  c.cx = v[2];
  c.cy = v[3];
  const std::size_t coefficients = c_.model == DistortionModel::kEquidistant ? 4 : 5;
  for (std::size_t i = 0; i < coefficients; ++i) {
    c.distortion[i] = v[4 + static_cast<Eigen::Index>(i)];
  }
  c.covariance.reset();
  return c;
}

IntrinsicJacobian CameraModel::intrinsicJacobian(const Eigen::Vector2d& normalized) const {
  const double x = normalized.x();
  const double y = normalized.y();
  const double r2 = x * x + y * y;
  // d (xd, yd) / d coefficients, before the focal lengths.
  Eigen::Matrix<double, 2, 5> D = Eigen::Matrix<double, 2, 5>::Zero();
  if (c_.model == DistortionModel::kEquidistant) {
    const double r = std::sqrt(r2);
    const double theta = std::atan(r);
    double power = r > 1e-9 ? theta * theta * theta / r : r2;  // theta^3 / r
    for (int i = 0; i < 4; ++i, power *= theta * theta) D.col(i) = power * normalized;
  } else {
    const std::array<double, 8>& d = c_.distortion;
    const double den = 1.0 + r2 * (d[5] + r2 * (d[6] + r2 * d[7]));
    D.col(0) = normalized * (r2 / den);
    D.col(1) = normalized * (r2 * r2 / den);
    D.col(2) << 2.0 * x * y, r2 + 2.0 * y * y;
    D.col(3) << r2 + 2.0 * x * x, 2.0 * x * y;
    D.col(4) = normalized * (r2 * r2 * r2 / den);
  }
  const Eigen::Vector2d pixel = distort(normalized);
  IntrinsicJacobian J;
  J << (pixel.x() - c_.cx) / c_.fx, 0.0, 1.0, 0.0, c_.fx * D.row(0),  //
      0.0, (pixel.y() - c_.cy) / c_.fy, 0.0, 1.0, c_.fy * D.row(1);
  return J;
}

std::optional<Eigen::Vector2d> CameraModel::undistort(const Eigen::Vector2d& pixel) const {
  constexpr int kIterations = 30;
  constexpr double kTolerance = 1e-10;
  Eigen::Vector2d n((pixel.x() - c_.cx) / c_.fx, (pixel.y() - c_.cy) / c_.fy);
  if (c_.model == DistortionModel::kEquidistant) {
    // Start at the undistorted fisheye: r = tan(theta).
    const double theta = n.norm();
    if (theta >= 1.5) return std::nullopt;
    if (theta > 1e-9) n *= std::tan(theta) / theta;
  }
  for (int i = 0; i < kIterations; ++i) {
    Eigen::Matrix2d J;
    const Eigen::Vector2d residual = pixel - distort(n, &J);
    const double determinant = J.determinant();
    if (!(determinant > 0.0)) return std::nullopt;
    const Eigen::Vector2d step = J.inverse() * residual;
    n += step;
    if (!n.allFinite() || n.norm() > max_radius_ + 0.5) return std::nullopt;
    if (step.squaredNorm() < kTolerance * kTolerance) {
      if (n.norm() > max_radius_) return std::nullopt;
      return n;
    }
  }
  return std::nullopt;
}

std::optional<Eigen::Vector2d> CameraModel::project(const Eigen::Vector3d& p_c) const {
  constexpr double kNearest = 1e-6;
  if (p_c.z() < kNearest) return std::nullopt;
  const Eigen::Vector2d n(p_c.x() / p_c.z(), p_c.y() / p_c.z());
  if (n.squaredNorm() > max_radius_ * max_radius_) return std::nullopt;
  return distort(n);
}

}  // namespace waymark::slam
