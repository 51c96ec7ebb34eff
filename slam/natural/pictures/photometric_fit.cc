#include "slam/natural/pictures/photometric_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "slam/geometry/reprojection.h"
#include "slam/geometry/robust.h"

namespace waymark::slam {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

// d pixel of the level / d delta of T_c_p, of a point at p_c in the camera's frame.
Matrix26d pixelJacobian(const Transform& T_c_p, const Eigen::Vector3d& p_c,
                        const CameraModel& camera, int level) {
  Eigen::Matrix2d J_lens;
  (void)camera.distort(p_c.head<2>() / p_c.z(), &J_lens);
  const Matrix26d J = markerJacobian(T_c_p, p_c, projectionJacobian(Transform{}, p_c));
  return J_lens * J / static_cast<double>(1 << level);
}

}  // namespace

PhotometricFit::PhotometricFit(const ExpectedPicture& expected, const std::vector<float>& blurred,
                               double inside_px, const Transform& T_c_p, const CameraModel& camera,
                               const GreyLevels& image)
    : camera_(camera), image_(image), level_(expected.level) {
  const auto inside = static_cast<float>(inside_px);
  for (int y = 1; y + 1 < expected.height; ++y) {
    for (int x = 1; x + 1 < expected.width; ++x) {
      const std::size_t i = expected.index(x, y);
      if (!(expected.inside_px[i] >= inside)) continue;
      const Eigen::RowVector2d gradient(
          0.5 * (blurred[i + 1] - blurred[i - 1]),
          0.5 * (blurred[expected.index(x, y + 1)] - blurred[expected.index(x, y - 1)]));
      PhotometricPixel pixel;
      pixel.on_print << expected.on_print[i].cast<double>(), 0.0;
      const Eigen::Vector3d p_c = T_c_p * pixel.on_print;
      if (p_c.z() < kNearestDepth) continue;
      pixel.J = gradient * pixelJacobian(T_c_p, p_c, camera, expected.level);
      pixel.expected = blurred[i];
      pixel.x = 2.0F * static_cast<float>(x) / static_cast<float>(expected.width - 1) - 1.0F;
      pixel.y = 2.0F * static_cast<float>(y) / static_cast<float>(expected.height - 1) - 1.0F;
      pixel.column = static_cast<std::int16_t>(expected.left + x);
      pixel.row = static_cast<std::int16_t>(expected.top + y);
      pixels_.push_back(pixel);
    }
  }
}

int PhotometricFit::computeResiduals(const Transform& T_c_p, const Light& light) {
  seen_.resize(pixels_.size());
  residuals_.resize(pixels_.size());
  const double scale = 1.0 / static_cast<double>(1 << level_);
  const double shift = 0.5 * scale - 0.5;
  const float last_x = static_cast<float>(image_.width) - 1.0F;
  const float last_y = static_cast<float>(image_.height) - 1.0F;
  int count = 0;
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    const PhotometricPixel& pixel = pixels_[i];
    const Eigen::Vector3d p_c = T_c_p * pixel.on_print;
    seen_[i] = kNone;
    residuals_[i] = kNone;
    if (p_c.z() < kNearestDepth) continue;
    const Eigen::Vector2d at = camera_.distort(p_c.head<2>() / p_c.z());
    const auto x = static_cast<float>(scale * at.x() + shift);
    const auto y = static_cast<float>(scale * at.y() + shift);
    if (!(x >= 0.0F && y >= 0.0F && x <= last_x && y <= last_y)) continue;
    const double expected = light.gain * pixel.expected + light.offset + light.slope_x * pixel.x +
                            light.slope_y * pixel.y;
    seen_[i] = image_.at(x, y);
    residuals_[i] = seen_[i] - static_cast<float>(expected);
    ++count;
  }
  return count;
}

Light PhotometricFit::fitLight(const Transform& T_c_p) {
  (void)computeResiduals(T_c_p, Light{});
  double n = 0.0;
  double e = 0.0;
  double s = 0.0;
  double ee = 0.0;
  double es = 0.0;
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    if (!std::isfinite(seen_[i])) continue;
    n += 1.0;
    e += pixels_[i].expected;
    s += seen_[i];
    ee += static_cast<double>(pixels_[i].expected) * pixels_[i].expected;
    es += static_cast<double>(pixels_[i].expected) * seen_[i];
  }
  Light light;
  const double spread = n * ee - e * e;
  // A print does not invert, and not even the weakest light takes all its contrast.
  constexpr double kLeastGain = 0.05;
  light.gain = spread > 1e-9 * ee ? std::max(kLeastGain, (n * es - e * s) / spread) : 1.0;
  light.offset = n > 0.0 ? (s - light.gain * e) / n : 0.0;
  return light;
}

double PhotometricFit::robustSigma() const {
  std::vector<float> sizes;
  sizes.reserve(residuals_.size());
  for (const float r : residuals_) {
    if (std::isfinite(r)) sizes.push_back(std::abs(r));
  }
  constexpr double kSigmaPerMedian = 1.4826;
  return sizes.empty() ? 0.0 : kSigmaPerMedian * static_cast<double>(median(std::move(sizes)));
}

double PhotometricFit::meanCost(double cutoff) const {
  double sum = 0.0;
  for (const float r : residuals_) {
    const double t = std::isfinite(r) ? r * r / (cutoff * cutoff) : 1.0;
    sum += t < 1.0 ? 1.0 - (1.0 - t) * (1.0 - t) * (1.0 - t) : 1.0;
  }
  return residuals_.empty() ? 1.0 : sum / static_cast<double>(residuals_.size());
}

PhotometricVector PhotometricFit::jacobian(std::size_t i, const Light& light) const {
  const PhotometricPixel& pixel = pixels_[i];
  PhotometricVector row;
  row << light.gain * pixel.J.transpose(), -pixel.expected, -1.0, -pixel.x, -pixel.y;
  return row;
}

void PhotometricFit::normalEquations(const Light& light, double cutoff, PhotometricMatrix* A,
                                     PhotometricVector* b) const {
  A->setZero();
  b->setZero();
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    if (!std::isfinite(residuals_[i])) continue;
    const double r = residuals_[i];
    const double weight = tukeyWeight(r * r / (cutoff * cutoff));
    if (weight <= 0.0) continue;
    const PhotometricVector row = jacobian(i, light);
    A->selfadjointView<Eigen::Lower>().rankUpdate(row, weight);
    *b += weight * r * row;
  }
  *A = A->selfadjointView<Eigen::Lower>();
}

}  // namespace waymark::slam
