#include "tools/calibration/saddle_fit.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/LU>

namespace waymark::calibration {
namespace {

using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;

// Grey = mean + swing * step(distance to edge a) * step(distance to edge b).
struct Crossing {
  Eigen::Vector2d at;
  double angle_a = 0.0, angle_b = 0.0;  // of the edges, radians
  double mean = 0.0, swing = 0.0;       // grey levels
  double blur_px = 0.0;

  [[nodiscard]] Crossing stepped(const Vector7d& step) const {
    return {at + step.head<2>(), angle_a + step[2], angle_b + step[3],
            mean + step[4],      swing + step[5],   blur_px + step[6]};
  }
};

struct Sample {
  Eigen::Vector2d pixel;
  double grey;
};

// A blurred step from -1 to 1, with its derivatives.
struct Step {
  double value, by_distance, by_blur, distance_by_angle;
  Eigen::Vector2d normal;

  Step(const Eigen::Vector2d& offset, double angle, double blur_px)
      : normal(-std::sin(angle), std::cos(angle)) {
    const double distance = normal.dot(offset);
    const double scaled = distance / blur_px;
    value = std::erf(scaled / std::numbers::sqrt2);
    by_distance = std::sqrt(2.0 / std::numbers::pi) / blur_px * std::exp(-0.5 * scaled * scaled);
    by_blur = -scaled * by_distance;
    distance_by_angle = -std::cos(angle) * offset.x() - std::sin(angle) * offset.y();
  }
};

struct Normal {
  Matrix7d H = Matrix7d::Zero();
  Vector7d g = Vector7d::Zero();
  double cost = 0.0;
};

Normal linearize(const std::vector<Sample>& samples, const Crossing& c) {
  Normal normal;
  for (const Sample& sample : samples) {
    const Eigen::Vector2d offset = sample.pixel - c.at;
    const Step a(offset, c.angle_a, c.blur_px);
    const Step b(offset, c.angle_b, c.blur_px);
    Vector7d J;
    J.head<2>() =
        -c.swing * (a.by_distance * b.value * a.normal + a.value * b.by_distance * b.normal);
    J[2] = c.swing * a.by_distance * a.distance_by_angle * b.value;
    J[3] = c.swing * a.value * b.by_distance * b.distance_by_angle;
    J[4] = 1.0;
    J[5] = a.value * b.value;
    J[6] = c.swing * (a.by_blur * b.value + a.value * b.by_blur);
    const double r = c.mean + c.swing * a.value * b.value - sample.grey;
    normal.H += J * J.transpose();
    normal.g += r * J;
    normal.cost += r * r;
  }
  return normal;
}

// Of a linear image of the unit circle: from pixels to where it is 1 in length.
using Ellipse = Eigen::Matrix2d;

std::vector<Sample> samplesAround(const ImageView& image, const Eigen::Vector2d& centre,
                                  const Eigen::Vector2d& reach_px, const Ellipse& ellipse) {
  std::vector<Sample> samples;
  const Eigen::Vector2d low = (centre - reach_px).array().ceil();
  const Eigen::Vector2d high = (centre + reach_px).array().floor();
  if (!(low.minCoeff() >= 0.0 && high.x() < image.width && high.y() < image.height)) return samples;
  for (int y = static_cast<int>(low.y()); y <= static_cast<int>(high.y()); ++y) {
    for (int x = static_cast<int>(low.x()); x <= static_cast<int>(high.x()); ++x) {
      const Eigen::Vector2d pixel(x, y);
      if ((ellipse * (pixel - centre)).squaredNorm() > 1.0) continue;
      samples.push_back({pixel, static_cast<double>(image.at(x, y))});
    }
  }
  return samples;
}

// Mean and swing follow from the rest by linear least squares.
void estimateLevels(const std::vector<Sample>& samples, Crossing* c) {
  Eigen::Matrix2d H = Eigen::Matrix2d::Zero();
  Eigen::Vector2d g = Eigen::Vector2d::Zero();
  for (const Sample& sample : samples) {
    const Eigen::Vector2d offset = sample.pixel - c->at;
    const Eigen::Vector2d J(1.0, Step(offset, c->angle_a, c->blur_px).value *
                                     Step(offset, c->angle_b, c->blur_px).value);
    H += J * J.transpose();
    g += sample.grey * J;
  }
  const Eigen::Vector2d levels = H.ldlt().solve(g);
  c->mean = levels[0];
  c->swing = levels[1];
}

}  // namespace

std::optional<Saddle> fitSaddle(const ImageView& image, const Eigen::Vector2d& guess,
                                const Eigen::Vector2d& axis_a, const Eigen::Vector2d& axis_b,
                                const SaddleFitOptions& options) {
  constexpr double kSettled_px = 1e-4;
  constexpr double kUnknowns = 7.0;
  constexpr double kDamping = 1e-3;  // keeps far steps of weakly determined angles short
  constexpr double kFarthest = 0.8;  // from the guess, as a share of the ellipse
  Eigen::Matrix2d axes;
  axes << axis_a, axis_b;
  const Ellipse ellipse = axes.inverse();
  if (!ellipse.allFinite()) return std::nullopt;
  const std::vector<Sample> samples = samplesAround(image, guess, axes.rowwise().norm(), ellipse);
  if (static_cast<double>(samples.size()) < 2.0 * kUnknowns) return std::nullopt;
  Crossing crossing{guess,
                    std::atan2(axis_a.y(), axis_a.x()),
                    std::atan2(axis_b.y(), axis_b.x()),
                    0.0,
                    0.0,
                    options.start_blur_px};
  estimateLevels(samples, &crossing);
  Normal normal = linearize(samples, crossing);
  for (int i = 0; i < options.iterations; ++i) {
    Matrix7d H = normal.H;
    H.diagonal() *= 1.0 + kDamping;
    const Vector7d step = -H.ldlt().solve(normal.g);
    if (!step.allFinite()) return std::nullopt;
    crossing = crossing.stepped(step);
    crossing.blur_px = std::clamp(crossing.blur_px, options.min_blur_px, options.max_blur_px);
    if (!((ellipse * (crossing.at - guess)).norm() < kFarthest)) return std::nullopt;
    normal = linearize(samples, crossing);
    if (step.head<2>().norm() < kSettled_px) break;
  }
  const double variance = normal.cost / (static_cast<double>(samples.size()) - kUnknowns);
  const double swing = std::abs(crossing.swing);
  if (2.0 * swing < options.min_contrast || std::sqrt(variance) > options.worst_misfit * swing) {
    return std::nullopt;
  }
  const Matrix7d inverse = normal.H.inverse();
  const double systematic = options.systematic_sigma_px * options.systematic_sigma_px;
  const Eigen::Matrix2d covariance =
      variance * inverse.topLeftCorner<2, 2>() + systematic * Eigen::Matrix2d::Identity();
  if (!covariance.allFinite()) return std::nullopt;
  return Saddle{crossing.at, covariance, crossing.blur_px};
}

}  // namespace waymark::calibration
