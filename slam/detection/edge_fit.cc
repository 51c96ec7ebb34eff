#include "slam/detection/edge_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include <Eigen/Cholesky>

#include "base/vectorised.h"

namespace waymark::slam {
namespace {

// The unknowns: shift at start and end, white, black, blur, and the slopes of white and black along
// the edge.
enum Unknown { kShiftStart, kShiftEnd, kWhite, kBlack, kBlur, kWhiteSlope, kBlackSlope };
constexpr std::size_t kUnknowns = 7;
using VectorU = Eigen::Matrix<double, kUnknowns, 1>;
using MatrixU = Eigen::Matrix<double, kUnknowns, kUnknowns>;

// Of the normal equations; H row by row of its lower triangle.
struct NormalSums {
  static constexpr std::size_t kTriangle = kUnknowns * (kUnknowns + 1) / 2;
  std::array<float, kTriangle> H{};
  std::array<float, kUnknowns> g{};
  float squares = 0.0F;
  float weights = 0.0F;

  [[nodiscard]] MatrixU matrix() const {
    MatrixU matrix;
    std::size_t k = 0;
    for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
      for (Eigen::Index j = 0; j <= i; ++j) matrix(i, j) = matrix(j, i) = H[k++];
    }
    return matrix;
  }
  [[nodiscard]] VectorU gradient() const {
    VectorU gradient;
    for (std::size_t i = 0; i < kUnknowns; ++i) gradient[static_cast<Eigen::Index>(i)] = g[i];
    return gradient;
  }
  // Of the residuals; at least a quarter, which quantisation makes.
  [[nodiscard]] double variance() const {
    const double degrees = std::max(static_cast<double>(weights) - double{kUnknowns}, 1.0);
    return std::max(static_cast<double>(squares) / degrees, 0.25);
  }
};

// How dark the model is at eight samples (1 = the border's grey level, 0 = the surroundings') and
// its derivatives.
struct Darkness {
  Lanes value;
  Lanes by_shift;
  Lanes by_blur;
};

// Which of eight samples' steps are not plains: whether any is near the side before or after, or in
// front of a white cell.
struct Neighbours {
  bool start;
  bool end;
  bool ring;
};
using BlockNeighbours = std::array<Neighbours, EdgeSamples::kCapacity / kLanes>;

// blur: the largest that is to be reckoned with.
void findNeighbours(const EdgeSamples& s, float blur, BlockNeighbours* blocks) {
  constexpr float kFar = 3.5F;  // standard deviations beyond which a step is a plain
  for (std::size_t i = 0; i < s.count; i += kLanes) {
    Neighbours& block = (*blocks)[i / kLanes];
    block = {};
    for (std::size_t k = i; k < i + kLanes; ++k) {
      block.start |= s.to_start[k] < kFar * blur;
      block.end |= s.to_end[k] < kFar * blur;
      block.ring |= s.ring_white[k] > 0.0F;
    }
  }
}

WAYMARK_INLINE void darknessAt(const EdgeSamples& s, std::size_t i, const Neighbours& near,
                               const Lanes& shift, float blur, Darkness* dark) {
  const float per_blur = 1.0F / blur;
  const Lanes& distance = lanesAt(s.distance.data(), i);
  const Lanes x = (shift - distance) * per_blur;
  NormalLanes step;
  normalAt(x, &step);
  dark->value = step.cdf;
  dark->by_shift = step.pdf * per_blur;
  if (near.start || near.end || near.ring) {
    Lanes factor = Lanes{} + 1.0F;
    if (near.start) {
      normalAt(lanesAt(s.to_start.data(), i) * per_blur, &step);
      factor *= step.cdf;
    }
    if (near.end) {
      normalAt(lanesAt(s.to_end.data(), i) * per_blur, &step);
      factor *= step.cdf;
    }
    if (near.ring) {
      normalAt(-(distance + lanesAt(s.thickness.data(), i)) * per_blur, &step);
      factor *= 1.0F - lanesAt(s.ring_white.data(), i) * step.cdf;
    }
    dark->value *= factor;
    dark->by_shift *= factor;
  }
  dark->by_blur = -dark->by_shift * x;
}

// cut: squared residual at which a pixel's weight has fallen to a half (Cauchy's kernel).
WAYMARK_VECTORISED void linearise(const EdgeSamples& samples, const BlockNeighbours& neighbours,
                                  const std::array<float, kUnknowns>& x, float cut,
                                  NormalSums* sums) {
  std::array<Lanes, NormalSums::kTriangle> H{};
  std::array<Lanes, kUnknowns> g{};
  Lanes squares{};
  Lanes weights{};
  const float contrast = x[kBlack] - x[kWhite];
  const float per_cut = 1.0F / cut;
  for (std::size_t i = 0; i < samples.count; i += kLanes) {
    const Lanes& t = lanesAt(samples.t.data(), i);
    const Lanes centred = t - 0.5F;
    const Lanes shift = x[kShiftStart] + t * (x[kShiftEnd] - x[kShiftStart]);
    Darkness dark;
    darknessAt(samples, i, neighbours[i / kLanes], shift, x[kBlur], &dark);
    const Lanes light = 1.0F - dark.value;
    const Lanes model = light * (x[kWhite] + x[kWhiteSlope] * centred) +
                        dark.value * (x[kBlack] + x[kBlackSlope] * centred);
    const Lanes residual = model - lanesAt(samples.grey.data(), i);
    const Lanes weight = lanesAt(samples.weight.data(), i) / (1.0F + residual * residual * per_cut);
    const Lanes by_shift = contrast * dark.by_shift;
    const std::array<Lanes, kUnknowns> J = {
        by_shift * (1.0F - t), by_shift * t,        light, dark.value, contrast * dark.by_blur,
        light * centred,       dark.value * centred};
    std::size_t k = 0;
#pragma GCC unroll 7
    for (std::size_t row = 0; row < kUnknowns; ++row) {
      const Lanes weighted = weight * J[row];
      g[row] += residual * weighted;
#pragma GCC unroll 7
      for (std::size_t column = 0; column <= row; ++column) H[k++] += weighted * J[column];
    }
    squares += weight * residual * residual;
    weights += weight;
  }
  for (std::size_t k = 0; k < H.size(); ++k) sums->H[k] = sumOf(H[k]);
  for (std::size_t k = 0; k < g.size(); ++k) sums->g[k] = sumOf(g[k]);
  sums->squares = sumOf(squares);
  sums->weights = sumOf(weights);
}

float pixelsIn(const EdgeSamples& samples) {
  float pixels = 0.0F;
  for (std::size_t i = 0; i < samples.count; ++i) pixels += samples.weight[i];
  return pixels;
}

}  // namespace

std::optional<EdgeFit> fitEdge(const EdgeSamples& samples, const EdgeFit& start,
                               const EdgeFitOptions& options) {
  constexpr float kFewest = 16.0F;
  constexpr double kConverged = 0.01;   // pixels: the next step would be a hundredth of it
  constexpr double kLongestStep = 1.5;  // pixels
  // Standard deviations of the priors that hold what a short edge cannot tell.
  constexpr double kSlopePrior = 10.0;  // grey levels from end to end
  constexpr double kBlurPrior = 0.5;    // pixels
  if (pixelsIn(samples) < kFewest) return std::nullopt;

  VectorU x;
  x << start.shift_start, start.shift_end, start.white, start.black, start.blur_px, 0.0, 0.0;
  constexpr double kMostGrowth = 1.3;  // of the blur
  BlockNeighbours neighbours;
  findNeighbours(samples, static_cast<float>(kMostGrowth * start.blur_px), &neighbours);
  Eigen::LLT<MatrixU> factors;
  double variance = 1e9;  // nothing is an outlier yet
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    const auto cut = static_cast<float>(9.0 * std::max(variance, 1.0));
    std::array<float, kUnknowns> xf;
    for (std::size_t i = 0; i < kUnknowns; ++i) {
      xf[i] = static_cast<float>(x[static_cast<Eigen::Index>(i)]);
    }
    NormalSums sums;
    linearise(samples, neighbours, xf, cut, &sums);
    MatrixU H = sums.matrix();
    VectorU g = sums.gradient();
    variance = sums.variance();
    const auto prior = [&](Unknown k, double mean, double sigma) {
      const double weight = variance / (sigma * sigma);
      H(k, k) += weight;
      g[k] += weight * (x[k] - mean);
    };
    prior(kBlur, start.blur_px, kBlurPrior);
    prior(kWhiteSlope, 0.0, kSlopePrior);
    prior(kBlackSlope, 0.0, kSlopePrior);

    factors.compute(H);
    if (factors.info() != Eigen::Success) return std::nullopt;
    VectorU step = factors.solve(g);
    if (!step.allFinite()) return std::nullopt;
    for (const Unknown k : {kShiftStart, kShiftEnd}) {
      step[k] = std::clamp(step[k], -kLongestStep, kLongestStep);
    }
    x -= step;
    x[kBlur] = std::clamp(x[kBlur], options.min_blur_px, options.max_blur_px);
    if (std::max(std::abs(x[kShiftStart]), std::abs(x[kShiftEnd])) > options.max_shift_px) {
      return std::nullopt;
    }
    const double moved = std::max(std::abs(step[kShiftStart]), std::abs(step[kShiftEnd]));
    if (iteration > 0 && moved < kConverged) break;
  }
  if (x[kWhite] - x[kBlack] < options.min_contrast) return std::nullopt;
  using Columns = Eigen::Matrix<double, kUnknowns, 2>;
  const Columns inverse = factors.solve(Columns::Identity());
  return EdgeFit{x[kShiftStart], x[kShiftEnd], variance * inverse.topRows<2>(),
                 x[kWhite],      x[kBlack],    x[kBlur]};
}

}  // namespace waymark::slam
