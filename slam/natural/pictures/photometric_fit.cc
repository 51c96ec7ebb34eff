#include "slam/natural/pictures/photometric_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>

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

double sigmaOf(std::vector<float> sizes) {
  constexpr double kSigmaPerMedian = 1.4826;
  return sizes.empty() ? 0.0 : kSigmaPerMedian * static_cast<double>(median(std::move(sizes)));
}

}  // namespace

void PixelBlock::add(double expected, double seen) {
  ++count;
  e += expected;
  s += seen;
  ee += expected * expected;
  ss += seen * seen;
  es += expected * seen;
}

void PixelBlock::add(const PixelBlock& other) {
  count += other.count;
  e += other.e;
  s += other.s;
  ee += other.ee;
  ss += other.ss;
  es += other.es;
}

double PixelBlock::contrast() const {
  return count > 0 ? std::sqrt(std::max(0.0, ee / count - e * e / count / count)) : 0.0;
}

double PixelBlock::correlation() const {
  if (count == 0) return 0.0;
  const double expected = ee - e * e / count;
  const double seen = ss - s * s / count;
  const double both = es - e * s / count;
  return expected > 0.0 && seen > 0.0 ? both / std::sqrt(expected * seen) : 0.0;
}

PhotometricFit::PhotometricFit(const ExpectedPicture& expected, const std::vector<float>& blurred,
                               double inside_px, const Transform& T_c_p, const CameraModel& camera,
                               const GreyLevels& image)
    : camera_(camera), image_(image), level_(expected.level) {
  const auto inside = static_cast<float>(inside_px);
  for (int y = 1; y + 1 < expected.height; ++y) {
    for (int x = 1; x + 1 < expected.width; ++x) {
      const std::size_t i = expected.index(x, y);
      if (!(expected.inside_px[i] >= inside)) continue;
      const float* above = blurred.data() + expected.index(x, y - 1);
      const float* here = blurred.data() + i;
      const float* below = blurred.data() + expected.index(x, y + 1);
      const Eigen::RowVector2d gradient(0.5 * (here[1] - here[-1]), 0.5 * (below[0] - above[0]));
      PhotometricPixel pixel;
      pixel.on_print << expected.on_print[i].cast<double>(), 0.0;
      const Eigen::Vector3d p_c = T_c_p * pixel.on_print;
      if (p_c.z() < kNearestDepth) continue;
      pixel.J = gradient * pixelJacobian(T_c_p, p_c, camera, expected.level);
      pixel.blur_J << 0.5F * (here[1] - 2.0F * here[0] + here[-1]),
          0.25F * (below[1] - below[-1] - above[1] + above[-1]),
          0.5F * (below[0] - 2.0F * here[0] + above[0]);
      pixel.expected = here[0];
      pixel.x = 2.0F * static_cast<float>(x) / static_cast<float>(expected.width - 1) - 1.0F;
      pixel.y = 2.0F * static_cast<float>(y) / static_cast<float>(expected.height - 1) - 1.0F;
      pixel.column = static_cast<std::int16_t>(expected.left + x);
      pixel.row = static_cast<std::int16_t>(expected.top + y);
      pixels_.push_back(pixel);
    }
  }
}

void PhotometricFit::computeResiduals(const Transform& T_c_p, const Light& light) {
  seen_.resize(pixels_.size());
  residuals_.resize(pixels_.size());
  const double scale = 1.0 / static_cast<double>(1 << level_);
  const double shift = 0.5 * scale - 0.5;
  const float last_x = static_cast<float>(image_.width) - 1.0F;
  const float last_y = static_cast<float>(image_.height) - 1.0F;
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
    seen_[i] = image_.at(x, y);
    const double expected = light[0] + gainAt(pixel, light) * pixel.expected;
    residuals_[i] = seen_[i] - static_cast<float>(expected);
  }
}

Light PhotometricFit::fitLight(const Transform& T_c_p, double outlier_sigmas) {
  constexpr int kRounds = 4;
  constexpr double kLeastGain = 0.05;  // a print does not invert, and keeps some contrast
  Light light = Light::Zero();
  light[1] = 1.0;
  double cutoff = std::numeric_limits<double>::infinity();
  computeResiduals(T_c_p, light);
  for (int round = 0; round < kRounds; ++round) {
    // Gain and offset alone at first: whatever hides the print would bend the others.
    const int terms = round < 2 ? 2 : 7;
    Eigen::Matrix<double, 7, 7> A = Eigen::Matrix<double, 7, 7>::Zero();
    Light b = Light::Zero();
    for (std::size_t i = 0; i < pixels_.size(); ++i) {
      if (!std::isfinite(residuals_[i])) continue;
      const double r = residuals_[i];
      const double weight = round == 0 ? 1.0 : tukeyWeight(r * r / (cutoff * cutoff));
      if (weight <= 0.0) continue;
      const Light row = lightTerms(pixels_[i]);
      A.selfadjointView<Eigen::Lower>().rankUpdate(row, weight);
      b += weight * seen_[i] * row;
    }
    A = A.selfadjointView<Eigen::Lower>();
    constexpr double kRidge = 1e-6;  // where the print leaves a term open
    A.diagonal() += kRidge * A.diagonal() + Light::Constant(1e-9);
    light.setZero();
    light.head(terms) = A.topLeftCorner(terms, terms).ldlt().solve(b.head(terms));
    if (!light.allFinite()) light << 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0;
    light[1] = std::max(light[1], kLeastGain);
    computeResiduals(T_c_p, light);
    cutoff = outlier_sigmas * std::max(0.3, robustSigma());
  }
  return light;
}

PixelBlocks PhotometricFit::blocks(const Transform& T_c_p, int block_px) {
  computeResiduals(T_c_p, Light::Zero());
  PixelBlocks blocks;
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    if (!std::isfinite(seen_[i])) continue;
    blocks[blockOf(pixels_[i], block_px)].add(pixels_[i].expected, seen_[i]);
  }
  return blocks;
}

void PhotometricFit::leaveOutHidden(const Transform& T_c_p, int block_px, double contrast,
                                    double correlation) {
  constexpr double kLeastLeft = 0.2;  // of the pixels
  const PixelBlocks all = blocks(T_c_p, block_px);
  std::vector<PhotometricPixel> left;
  for (const PhotometricPixel& pixel : pixels_) {
    const auto block = all.find(blockOf(pixel, block_px));
    if (block == all.end()) continue;
    const bool texture = block->second.contrast() >= contrast;
    if (texture && block->second.correlation() < correlation) continue;
    left.push_back(pixel);
  }
  if (static_cast<double>(left.size()) < kLeastLeft * static_cast<double>(pixels_.size())) return;
  pixels_ = std::move(left);
  computeResiduals(T_c_p, Light::Zero());
}

double PhotometricFit::robustSigma() const {
  std::vector<float> sizes;
  sizes.reserve(residuals_.size());
  for (const float r : residuals_) {
    if (std::isfinite(r)) sizes.push_back(std::abs(r));
  }
  return sigmaOf(std::move(sizes));
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
  row << gainAt(pixel, light) * pixel.J.transpose(), -lightTerms(pixel);
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

Eigen::Vector3d PhotometricFit::blurStep(const Light& light, double cutoff) const {
  using Vector5d = Eigen::Matrix<double, 5, 1>;
  Eigen::Matrix<double, 5, 5> A = Eigen::Matrix<double, 5, 5>::Zero();
  Vector5d b = Vector5d::Zero();
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    if (!std::isfinite(residuals_[i])) continue;
    const double r = residuals_[i];
    const double weight = tukeyWeight(r * r / (cutoff * cutoff));
    Vector5d row;
    row << gainAt(pixels_[i], light) * pixels_[i].blur_J.cast<double>(), 1.0, pixels_[i].expected;
    A += weight * row * row.transpose();
    b += weight * r * row;
  }
  const Eigen::LDLT<Eigen::Matrix<double, 5, 5>> factor(A);
  if (factor.info() != Eigen::Success || !factor.isPositive()) return Eigen::Vector3d::Zero();
  const Eigen::Vector3d step = factor.solve(b).head<3>();
  return step.allFinite() ? step : Eigen::Vector3d::Zero();
}

}  // namespace waymark::slam
