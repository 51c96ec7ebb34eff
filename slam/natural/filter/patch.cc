#include "slam/natural/filter/patch.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <Eigen/LU>

#include "base/vectorized.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

constexpr int kSide = PatchSource::kSide;
constexpr int kWarpedSide = kPatchSide + 2;  // with a margin for gradients
constexpr double kHalfSide = 0.5 * (kPatchSide - 1);
// A match between whole pixels correlates less than it will.
constexpr double kSearchMargin = 0.2;
// Unknowns of a match: a shift, a gain and an offset.
constexpr int kUnknowns = 4;
// Where a patch's surface would turn away from the camera within the patch, it is not warped on.
constexpr float kLeastPerspective = 0.2F;

using Eight = float __attribute__((vector_size(32), aligned(4), may_alias));
using EightBytes = std::uint8_t __attribute__((vector_size(8), aligned(1), may_alias));

// Sums over a patch of the image, its grey levels less `mean`.
struct PatchSums {
  float value, squares, with_value, with_dx, with_dy;
};

// corner: the pixel up and left of the patch's first sample, which is (fx, fy) beyond it.
WAYMARK_VECTORIZED void sumsAt(const std::uint8_t* corner, std::ptrdiff_t stride, float fx,
                               float fy, float mean, const float* value, const float* dx,
                               const float* dy, PatchSums* out) {
  Eight sum = {};
  Eight squares = {};
  Eight with_value = {};
  Eight with_dx = {};
  Eight with_dy = {};
  const float left = 1.0F - fx;
  const float up = 1.0F - fy;
  Eight above =
      __builtin_convertvector(*reinterpret_cast<const EightBytes*>(corner), Eight) * left +
      __builtin_convertvector(*reinterpret_cast<const EightBytes*>(corner + 1), Eight) * fx;
  for (int y = 0; y < kPatchSide; ++y) {
    corner += stride;
    const Eight below =
        __builtin_convertvector(*reinterpret_cast<const EightBytes*>(corner), Eight) * left +
        __builtin_convertvector(*reinterpret_cast<const EightBytes*>(corner + 1), Eight) * fx;
    const Eight grey = above * up + below * fy - mean;
    above = below;
    const int at = y * kPatchSide;
    sum += grey;
    squares += grey * grey;
    with_value += grey * *reinterpret_cast<const Eight*>(value + at);
    with_dx += grey * *reinterpret_cast<const Eight*>(dx + at);
    with_dy += grey * *reinterpret_cast<const Eight*>(dy + at);
  }
  *out = {};
  for (int i = 0; i < kPatchSide; ++i) {
    out->value += sum[i];
    out->squares += squares[i];
    out->with_value += with_value[i];
    out->with_dx += with_dx[i];
    out->with_dy += with_dy[i];
  }
}

// The same for whole pixels and without gradients.
WAYMARK_VECTORIZED void sumsAtWhole(const std::uint8_t* first, std::ptrdiff_t stride, float mean,
                                    const float* value, PatchSums* out) {
  Eight sum = {};
  Eight squares = {};
  Eight with_value = {};
  for (int y = 0; y < kPatchSide; ++y, first += stride) {
    const Eight grey =
        __builtin_convertvector(*reinterpret_cast<const EightBytes*>(first), Eight) - mean;
    sum += grey;
    squares += grey * grey;
    with_value += grey * *reinterpret_cast<const Eight*>(value + y * kPatchSide);
  }
  *out = {};
  for (int i = 0; i < kPatchSide; ++i) {
    out->value += sum[i];
    out->squares += squares[i];
    out->with_value += with_value[i];
  }
}

void cut(const ImageView& image, int left, int top, PatchSource::Pixels* pixels) {
  for (int y = 0; y < kSide; ++y) {
    const std::uint8_t* const row = image.row(std::clamp(top + y, 0, image.height - 1));
    std::uint8_t* const out = pixels->data() + std::ptrdiff_t{y} * kSide;
    if (left >= 0 && left + kSide <= image.width) {
      std::memcpy(out, row + left, kSide);
      continue;
    }
    for (int x = 0; x < kSide; ++x) out[x] = row[std::clamp(left + x, 0, image.width - 1)];
  }
}

float sample(const PatchSource::Pixels& pixels, float x, float y) {
  constexpr float kLast = kSide - 1.001F;
  x = std::clamp(x, 0.0F, kLast);
  y = std::clamp(y, 0.0F, kLast);
  const int column = static_cast<int>(x);
  const int row = static_cast<int>(y);
  const float fx = x - static_cast<float>(column);
  const float fy = y - static_cast<float>(row);
  const std::uint8_t* const p = pixels.data() + row * kSide + column;
  const auto a = static_cast<float>(p[0]);
  const auto b = static_cast<float>(p[kSide]);
  const float above = a + fx * (static_cast<float>(p[1]) - a);
  const float below = b + fx * (static_cast<float>(p[kSide + 1]) - b);
  return above + fy * (below - above);
}

float takeMeanOff(std::array<float, kPatchPixels>* values) {
  float sum = 0.0F;
  for (const float v : *values) sum += v;
  const float mean = sum / kPatchPixels;
  for (float& v : *values) v -= mean;
  return mean;
}

}  // namespace

std::string PatchOptions::invalidReason() const {
  return firstUnmet({
      {isPositive(image_noise), "image_noise must be positive"},
      {isNotNegative(systematic_px), "systematic_px must not be negative"},
      {isNotNegative(systematic_per_stretch_px), "systematic_per_stretch_px must not be negative"},
      {min_correlation > 0.0 && min_correlation < 1.0, "min_correlation must be between 0 and 1"},
      {max_iterations >= 1, "max_iterations must be at least 1"},
      {isPositive(converged_px), "converged_px must be positive"},
      {isPositive(max_shift_px), "max_shift_px must be positive"},
  });
}

void cutPatch(const ImageView& image, const ImageView& half, int x, int y, PatchSource* source) {
  constexpr int kMiddle = kSide / 2;
  cut(image, x - kMiddle, y - kMiddle, &source->fine);
  source->centre_fine = {kMiddle, kMiddle};
  const Eigen::Vector2f coarse(0.5F * (static_cast<float>(x) - 0.5F),
                               0.5F * (static_cast<float>(y) - 0.5F));
  const int left = static_cast<int>(std::floor(coarse.x())) - kMiddle;
  const int top = static_cast<int>(std::floor(coarse.y())) - kMiddle;
  cut(half, left, top, &source->coarse);
  source->centre_coarse =
      coarse - Eigen::Vector2f(static_cast<float>(left), static_cast<float>(top));
}

bool warpPatch(const PatchSource& source, const PatchWarp& warp, int level, PatchTemplate* patch) {
  const double step = std::sqrt(std::abs(warp.anchor_from_now.determinant())) * (1 << level);
  // Where a pixel now is more than one then, what was seen then at half the size.
  constexpr double kCoarser = 1.5;
  const bool coarse = step >= kCoarser;
  const Eigen::Matrix2f A =
      (warp.anchor_from_now * (coarse ? 0.5 * (1 << level) : 1.0 * (1 << level))).cast<float>();
  const Eigen::Vector2f bend = ((1 << level) * warp.bend).cast<float>();
  const PatchSource::Pixels& pixels = coarse ? source.coarse : source.fine;
  const Eigen::Vector2f centre = coarse ? source.centre_coarse : source.centre_fine;
  std::array<float, kWarpedSide * kWarpedSide> warped;
  for (int y = 0; y < kWarpedSide; ++y) {
    const float v = static_cast<float>(y) - static_cast<float>(kHalfSide) - 1.0F;
    for (int x = 0; x < kWarpedSide; ++x) {
      const float u = static_cast<float>(x) - static_cast<float>(kHalfSide) - 1.0F;
      const float w = 1.0F / std::max(kLeastPerspective, 1.0F - bend.x() * u - bend.y() * v);
      warped[static_cast<std::size_t>(y * kWarpedSide + x)] =
          sample(pixels, centre.x() + w * (A(0, 0) * u + A(0, 1) * v),
                 centre.y() + w * (A(1, 0) * u + A(1, 1) * v));
    }
  }
  for (int y = 0; y < kPatchSide; ++y) {
    for (int x = 0; x < kPatchSide; ++x) {
      const auto i = static_cast<std::size_t>(y * kPatchSide + x);
      const auto w = static_cast<std::size_t>((y + 1) * kWarpedSide + x + 1);
      patch->value[i] = warped[w];
      patch->dx[i] = 0.5F * (warped[w + 1] - warped[w - 1]);
      patch->dy[i] = 0.5F * (warped[w + kWarpedSide] - warped[w - kWarpedSide]);
    }
  }
  patch->mean = takeMeanOff(&patch->value);
  takeMeanOff(&patch->dx);
  takeMeanOff(&patch->dy);
  Eigen::Matrix3d N = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < kPatchPixels; ++i) {
    const Eigen::Vector3d j(patch->dx[i], patch->dy[i], patch->value[i]);
    N += j * j.transpose();
  }
  patch->sum_squares = static_cast<float>(N(2, 2));
  // A pixel's worth of noise must not be worth more than half a pixel of shift.
  constexpr double kLeastGradient = 4.0;
  const double trace = N(0, 0) + N(1, 1);
  const double determinant = N(0, 0) * N(1, 1) - N(0, 1) * N(0, 1);
  if (!(determinant > kLeastGradient * trace)) return false;
  bool invertible = false;
  N.computeInverseWithCheck(patch->inverse, invertible, 1e-6);
  return invertible && patch->inverse.allFinite();
}

std::optional<PatchMatch> alignPatch(const ImageView& image, const PatchTemplate& patch,
                                     const Eigen::Vector2d& start, const PatchOptions& options) {
  Eigen::Vector2d at = start;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    const double left = at.x() - kHalfSide;
    const double top = at.y() - kHalfSide;
    if (!(left >= 0.0) || !(top >= 0.0) || !(left + kPatchSide + 1 < image.width) ||
        !(top + kPatchSide + 1 < image.height)) {
      return std::nullopt;
    }
    const int x = static_cast<int>(left);
    const int y = static_cast<int>(top);
    PatchSums sums{};
    sumsAt(image.row(y) + x, image.stride, static_cast<float>(left - x),
           static_cast<float>(top - y), patch.mean, patch.value.data(), patch.dx.data(),
           patch.dy.data(), &sums);
    const Eigen::Vector3d right(sums.with_dx, sums.with_dy, sums.with_value);
    // The image is gain * (template + gradient * shift) + offset.
    const Eigen::Vector3d q = patch.inverse * right;
    const double gain = q[2];
    constexpr double kLeastGain = 0.3;
    constexpr double kMostGain = 3.0;
    if (!(gain > kLeastGain) || !(gain < kMostGain)) return std::nullopt;
    const Eigen::Vector2d shift = q.head<2>() / gain;
    at -= shift;
    if (!((at - start).cwiseAbs().maxCoeff() <= options.max_shift_px)) return std::nullopt;
    if (shift.squaredNorm() > options.converged_px * options.converged_px) continue;
    const double variation =
        sums.squares - static_cast<double>(sums.value) * sums.value / kPatchPixels;
    const double correlation =
        sums.with_value / std::sqrt(std::max(1e-6, variation * patch.sum_squares));
    if (!(correlation >= options.min_correlation)) return std::nullopt;
    const double residual = std::max(0.0, variation - q.dot(right)) / (kPatchPixels - kUnknowns);
    // Both images have noise. What interpolation takes off the residuals it does not take off the
    // sums over the patch: hence twice the residuals', too.
    const double noise2 = 2.0 * std::max(residual, options.image_noise * options.image_noise);
    PatchMatch match;
    match.at = at;
    match.correlation = correlation;
    match.covariance = noise2 / (gain * gain) * patch.inverse.topLeftCorner<2, 2>();
    return match;
  }
  return std::nullopt;
}

std::optional<Eigen::Vector2d> searchPatch(const ImageView& image, const PatchTemplate& patch,
                                           const Eigen::Vector2d& centre,
                                           const Eigen::Matrix2d& information, int reach_px,
                                           const PatchOptions& options) {
  // Samples lie half a pixel beside the middle: so do the places that are tried.
  const int middle_x = static_cast<int>(std::floor(centre.x()));
  const int middle_y = static_cast<int>(std::floor(centre.y()));
  constexpr int kBefore = kPatchSide / 2 - 1;
  double best = options.min_correlation - kSearchMargin;
  std::optional<Eigen::Vector2d> found;
  for (int y = middle_y - reach_px; y <= middle_y + reach_px; ++y) {
    if (y - kBefore < 0 || y - kBefore + kPatchSide > image.height) continue;
    for (int x = middle_x - reach_px; x <= middle_x + reach_px; ++x) {
      if (x - kBefore < 0 || x - kBefore + kPatchSide > image.width) continue;
      const Eigen::Vector2d place(x + 0.5, y + 0.5);
      const Eigen::Vector2d d = place - centre;
      // A step beyond the ellipse's edge may be the nearest one to a place inside.
      if (d.dot(information * d) > 1.0 && d.cwiseAbs().maxCoeff() > 1.0) continue;
      PatchSums sums{};
      sumsAtWhole(image.row(y - kBefore) + x - kBefore, image.stride, patch.mean,
                  patch.value.data(), &sums);
      const double variation =
          sums.squares - static_cast<double>(sums.value) * sums.value / kPatchPixels;
      const double correlation =
          sums.with_value / std::sqrt(std::max(1e-6, variation * patch.sum_squares));
      if (!(correlation > best)) continue;
      best = correlation;
      found = place;
    }
  }
  return found;
}

}  // namespace waymark::slam
