#include "slam/natural/filter/surface.h"

#include <cmath>

#include <Eigen/LU>

namespace waymark::slam {
namespace {

constexpr std::size_t kFewest = 5;
// Surfaces are rarely turned further than this, as a tangent: the prior of one that is badly seen.
constexpr double kTypicalSlope = 1.5;
// What counts as a plane: relief of this share of the distance.
constexpr double kRelief = 0.02;
// Mean squared residual, in units of the points' sigmas, beyond which there is none.
constexpr double kWorstFit = 2.5;
// A gradient known worse than this says nothing.
constexpr double kWorstSigma = 0.4;

}  // namespace

std::optional<Eigen::Vector2d> surfaceGradient(std::span<const SurfacePoint> points) {
  if (points.size() < kFewest) return std::nullopt;
  Eigen::Matrix2d N = Eigen::Matrix2d::Identity() / (kTypicalSlope * kTypicalSlope);
  Eigen::Vector2d b = Eigen::Vector2d::Zero();
  for (const SurfacePoint& p : points) {
    const double weight = 1.0 / (p.sigma * p.sigma + kRelief * kRelief);
    N += weight * (p.offset * p.offset.transpose());
    b += weight * p.relative * p.offset;
  }
  const Eigen::Matrix2d inverse = N.inverse();
  if (!(inverse.trace() < kWorstSigma * kWorstSigma)) return std::nullopt;
  const Eigen::Vector2d gradient = inverse * b;
  double fit = 0.0;
  for (const SurfacePoint& p : points) {
    const double residual = p.relative - gradient.dot(p.offset);
    fit += residual * residual / (p.sigma * p.sigma + kRelief * kRelief);
  }
  if (!(fit / static_cast<double>(points.size()) < kWorstFit)) return std::nullopt;
  return gradient;
}

}  // namespace waymark::slam
