#include "slam/detection/edge_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include <Eigen/Cholesky>

namespace waymark::slam {
namespace {

// The Gaussian's distribution function and density, tabulated: they are needed some thousand times
// per marker.
class GaussTable {
 public:
  struct Value {
    float cdf;
    float pdf;
  };

  GaussTable() {
    for (int i = 0; i <= kSize; ++i) {
      const double x = -kRange + i / kPerUnit;
      table_[static_cast<std::size_t>(i)] = {
          static_cast<float>(0.5 * std::erfc(-x / std::sqrt(2.0))),
          static_cast<float>(std::exp(-0.5 * x * x) / std::sqrt(2.0 * M_PI))};
    }
  }
  [[nodiscard]] Value at(float x) const {
    const float position = (x + kRange) * kPerUnit;
    if (!(position > 0.0F)) return {0.0F, 0.0F};
    if (position >= static_cast<float>(kSize)) return {1.0F, 0.0F};
    const auto i = static_cast<std::size_t>(position);
    const float f = position - static_cast<float>(i);
    const Value& low = table_[i];
    const Value& high = table_[i + 1];
    return {low.cdf + f * (high.cdf - low.cdf), low.pdf + f * (high.pdf - low.pdf)};
  }
  [[nodiscard]] float cdf(float x) const { return at(x).cdf; }

 private:
  static constexpr float kRange = 4.5F;
  static constexpr float kPerUnit = 64.0F;
  static constexpr int kSize = 576;
  std::array<Value, kSize + 1> table_{};
};

const GaussTable& gauss() {
  static const GaussTable table;
  return table;
}

// How dark the model is at a sample (1 = the border's grey level, 0 = the surroundings') and its
// derivatives.
struct Darkness {
  float value;
  float by_shift;
  float by_blur;
};

Darkness darknessAt(const GaussTable& table, const EdgeSample& s, float shift, float blur) {
  float factor = table.cdf(s.to_start / blur) * table.cdf(s.to_end / blur);
  if (s.ring_white > 0.0F) {
    factor *= 1.0F - s.ring_white * table.cdf(-(s.distance + s.thickness) / blur);
  }
  const float x = (shift - s.distance) / blur;
  const GaussTable::Value value = table.at(x);
  const float slope = value.pdf / blur * factor;
  return {value.cdf * factor, slope, -slope * x};
}

// The unknowns: shift at start and end, white, black, blur, and the slopes of white and black along
// the edge.
enum Unknown { kShiftStart, kShiftEnd, kWhite, kBlack, kBlur, kWhiteSlope, kBlackSlope };
constexpr int kUnknowns = 7;
using VectorU = Eigen::Matrix<double, kUnknowns, 1>;
using MatrixU = Eigen::Matrix<double, kUnknowns, kUnknowns>;

// Sums of the normal equations in single precision, padded to whole vectors: the loop over the
// pixels is the refiner's cost.
struct NormalSums {
  using Row = Eigen::Matrix<float, 8, 1>;
  Eigen::Matrix<float, 8, 8> H = Eigen::Matrix<float, 8, 8>::Zero();
  Row g = Row::Zero();
  float squares = 0.0F;
  float weights = 0.0F;

  void add(const Row& J, float residual, float weight) {
    const Row wJ = weight * J;
    H.noalias() += wJ * J.transpose();
    g.noalias() += residual * wJ;
    squares += weight * residual * residual;
    weights += weight;
  }

  // Of the residuals; at least a quarter, which quantisation makes.
  [[nodiscard]] double variance() const {
    const double degrees = std::max(static_cast<double>(weights) - kUnknowns, 1.0);
    return std::max(static_cast<double>(squares) / degrees, 0.25);
  }
};

// cut: squared residual at which a pixel's weight has fallen to a half (Cauchy's kernel).
NormalSums linearise(std::span<const EdgeSample> samples, const VectorU& x, float cut) {
  const GaussTable& table = gauss();
  const Eigen::Matrix<float, kUnknowns, 1> xf = x.cast<float>();
  const float contrast = xf[kBlack] - xf[kWhite];
  NormalSums sums;
  for (const EdgeSample& s : samples) {
    const float centred = s.t - 0.5F;
    const float shift = xf[kShiftStart] + s.t * (xf[kShiftEnd] - xf[kShiftStart]);
    const Darkness dark = darknessAt(table, s, shift, xf[kBlur]);
    const float light = 1.0F - dark.value;
    const float model = light * (xf[kWhite] + xf[kWhiteSlope] * centred) +
                        dark.value * (xf[kBlack] + xf[kBlackSlope] * centred);
    const float residual = model - s.grey;
    const float by_shift = contrast * dark.by_shift;
    NormalSums::Row J;
    J << by_shift * (1.0F - s.t), by_shift * s.t, light, dark.value, contrast * dark.by_blur,
        light * centred, dark.value * centred, 0.0F;
    sums.add(J, residual, 1.0F / (1.0F + residual * residual / cut));
  }
  return sums;
}

}  // namespace

float blurredStep(float x) { return gauss().cdf(x); }

std::optional<EdgeFit> fitEdge(std::span<const EdgeSample> samples, const EdgeFit& start,
                               const EdgeFitOptions& options) {
  constexpr std::size_t kFewest = 16;
  constexpr double kConverged = 0.003;  // pixels
  constexpr double kLongestStep = 1.5;  // pixels
  // Standard deviations of the priors that hold what a short edge cannot tell.
  constexpr double kSlopePrior = 10.0;  // grey levels from end to end
  constexpr double kBlurPrior = 0.5;    // pixels
  if (samples.size() < kFewest) return std::nullopt;

  VectorU x;
  x << start.shift_start, start.shift_end, start.white, start.black, start.blur_px, 0.0, 0.0;
  MatrixU H;
  double variance = 1e9;  // nothing is an outlier yet
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    const auto cut = static_cast<float>(9.0 * std::max(variance, 1.0));
    const NormalSums sums = linearise(samples, x, cut);
    H = sums.H.topLeftCorner<kUnknowns, kUnknowns>().cast<double>();
    VectorU g = sums.g.head<kUnknowns>().cast<double>();
    variance = sums.variance();
    const auto prior = [&](Unknown k, double mean, double sigma) {
      const double weight = variance / (sigma * sigma);
      H(k, k) += weight;
      g[k] += weight * (x[k] - mean);
    };
    prior(kBlur, start.blur_px, kBlurPrior);
    prior(kWhiteSlope, 0.0, kSlopePrior);
    prior(kBlackSlope, 0.0, kSlopePrior);

    VectorU step = Eigen::LDLT<MatrixU>(H).solve(g);
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
  const MatrixU inverse = Eigen::LDLT<MatrixU>(H).solve(MatrixU::Identity());
  return EdgeFit{x[kShiftStart], x[kShiftEnd], variance * inverse.topLeftCorner<2, 2>(),
                 x[kWhite],      x[kBlack],    x[kBlur]};
}

}  // namespace waymark::slam
