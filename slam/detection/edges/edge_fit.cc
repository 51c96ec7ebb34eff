#include "slam/detection/edges/edge_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include <Eigen/LU>

#include "base/vectorized.h"
#include "slam/geometry/small_cholesky.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// The unknowns: shift at start and end, white, black, blur, the slopes of white and black along the
// edge, how much lighter than white it is behind the paper, and by how much the paper's margin is
// wider than the border.
enum Unknown {
  kShiftStart,
  kShiftEnd,
  kWhite,
  kBlack,
  kBlur,
  kWhiteSlope,
  kBlackSlope,
  kBehind,
  kMargin
};
constexpr std::size_t kUnknowns = 9;
using VectorU = Eigen::Matrix<double, kUnknowns, 1>;
using MatrixU = Eigen::Matrix<double, kUnknowns, kUnknowns>;

// What the normal equations are made of: H row by row of its lower triangle, the gradient, the sum
// of squared residuals and that of the weights; and for a shift with a bow, H's third and fourth
// moments along the edge and the second one of the gradient.
constexpr std::size_t kTriangle = kUnknowns * (kUnknowns + 1) / 2;
constexpr std::size_t kSquares = kTriangle + kUnknowns;
constexpr std::size_t kWeights = kSquares + 1;
constexpr std::size_t kThird = kWeights + 1;
constexpr std::size_t kFourth = kThird + 1;
constexpr std::size_t kGradientSecond = kFourth + 1;
constexpr std::size_t kTerms = kGradientSecond + 1;
constexpr std::size_t kSums = (kTerms + kLanes - 1) / kLanes * kLanes;  // the last are none

struct NormalSums {
  alignas(32) std::array<float, kSums> sums{};

  [[nodiscard]] MatrixU matrix() const {
    MatrixU matrix;
    std::size_t k = 0;
    for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
      for (Eigen::Index j = 0; j <= i; ++j) matrix(i, j) = matrix(j, i) = sums[k++];
    }
    return matrix;
  }
  [[nodiscard]] VectorU gradient() const {
    VectorU gradient;
    for (std::size_t i = 0; i < kUnknowns; ++i) {
      gradient[static_cast<Eigen::Index>(i)] = sums[kTriangle + i];
    }
    return gradient;
  }
  // Of the residuals; at least a quarter, which quantization makes.
  [[nodiscard]] double variance() const {
    const double degrees = static_cast<double>(sums[kWeights]) - double{kUnknowns};
    return std::max(static_cast<double>(sums[kSquares]) / std::max(degrees, 1.0), 0.25);
  }
};

// Which steps of eight rows are not plains: whether any of their samples is near the side before or
// after, in front of a white cell, or near the end of the paper: then those from `margin_from` to
// before `margin_to`.
struct Neighbours {
  bool start;
  bool end;
  bool ring;
  std::size_t margin_from;
  std::size_t margin_to;
};
using GroupNeighbours = std::array<Neighbours, EdgeRows::kMaxRows / kLanes>;

WAYMARK_INLINE bool isAny(const IntLanes& lanes) {
  std::int32_t any = 0;
  for (std::size_t k = 0; k < kLanes; ++k) any |= lanes[k];
  return any != 0;
}

// blur_px: the largest that is to be reckoned with. Precondition: there are rows.
WAYMARK_VECTORIZED void findNeighbours(const EdgeRows& rows, float blur_px,
                                       GroupNeighbours* groups) {
  const float reach = kBlurReach * blur_px;
  const auto last = static_cast<float>(rows.across() - 1);
  const bool outwards = rows.step[0] > 0.0F;  // the same in all rows of a side
  for (std::size_t i = 0; i < rows.rows(); i += kLanes) {
    Neighbours& group = (*groups)[i / kLanes];
    const Lanes innermost = lanesAt(rows.innermost.data(), i);
    const Lanes outermost = lanesAt(rows.outermost.data(), i);
    const Lanes thickness = lanesAt(rows.thickness.data(), i);
    const IntLanes counts = innermost <= outermost;
    const float to_start = reach - std::min(0.0F, last * rows.to_start_step);
    const float to_end = reach - std::min(0.0F, last * rows.to_end_step);
    group.start = isAny(counts & (lanesAt(rows.to_start.data(), i) < to_start));
    group.end = isAny(counts & (lanesAt(rows.to_end.data(), i) < to_end));
    group.ring = isAny(counts & (lanesAt(rows.ring_white.data(), i) > 0.0F) &
                       (thickness + innermost < reach));
    const Lanes paper = paperAlone(thickness, blur_px);
    const IntLanes sees_behind = counts & (outermost > paper);
    const Lanes samples = (paper - lanesAt(rows.distance.data(), i)) / lanesAt(rows.step.data(), i);
    float first = last + 1.0F;
    float past = 0.0F;
    for (std::size_t k = 0; k < kLanes; ++k) {
      if (sees_behind[k] == 0) continue;
      const float at = std::clamp(samples[k], 0.0F, last);
      first = std::min(first, outwards ? at : 0.0F);
      past = std::max(past, outwards ? last + 1.0F : at + 1.0F);
    }
    group.margin_from = static_cast<std::size_t>(first);
    group.margin_to = static_cast<std::size_t>(past);
  }
}

// One sample of eight rows each: its weight, its residual, and that one's derivatives by shift,
// black, blur, what is behind the paper and where it ends. The derivative by white is 1 less the
// one by black.
struct Sample {
  Lanes weight, residual;
  Lanes shift, dark, blur;
  Lanes beyond, margin;  // known near the end of the paper
};
using Samples = std::array<Sample, EdgeRows::kMaxAcross>;

// A weighted derivative times 1, the others and the residual, summed over samples.
struct CrossSums {
  Lanes one{}, shift{}, dark{}, blur{}, beyond{}, residual{};
};

// Sums over the samples of eight rows: what the normal equations are made of. s, d and b are the
// derivatives by shift, black and blur; r is the residual, w the weight.
struct RowSums {
  Lanes w{}, ws{}, wd{}, wb{}, wr{};
  Lanes ss{}, sd{}, sb{}, dd{}, db{}, bb{};
  Lanes sr{}, dr{}, br{}, rr{};
  CrossSums beyond, margin;
  Lanes margins{};  // by margin, squared
};

// So few sums at a time stay in registers.
WAYMARK_INLINE void sumUp(const Sample* from, const Sample* end, RowSums* sums) {
  RowSums s;
  for (const Sample* p = from; p != end; ++p) {
    const Lanes r = p->weight * p->residual;
    s.w += p->weight;
    s.ws += p->weight * p->shift;
    s.wd += p->weight * p->dark;
    s.wb += p->weight * p->blur;
    s.wr += r;
    s.rr += r * p->residual;
  }
  for (const Sample* p = from; p != end; ++p) {
    const Lanes shift = p->weight * p->shift;
    const Lanes dark = p->weight * p->dark;
    const Lanes blur = p->weight * p->blur;
    s.ss += shift * p->shift;
    s.sd += shift * p->dark;
    s.sb += shift * p->blur;
    s.sr += shift * p->residual;
    s.dd += dark * p->dark;
    s.db += dark * p->blur;
    s.dr += dark * p->residual;
    s.bb += blur * p->blur;
    s.br += blur * p->residual;
  }
  *sums = s;
}

// by: one of the derivatives.
WAYMARK_INLINE void sumUp(const Sample* from, const Sample* end, Lanes Sample::*by,
                          CrossSums* sums) {
  CrossSums s;
  for (const Sample* p = from; p != end; ++p) {
    const Lanes weighted = p->weight * p->*by;
    s.one += weighted;
    s.shift += weighted * p->shift;
    s.dark += weighted * p->dark;
    s.blur += weighted * p->blur;
    s.beyond += weighted * p->beyond;
    s.residual += weighted * p->residual;
  }
  *sums = s;
}

// Adds the terms of NormalSums that are of eight rows, each row's t put in.
WAYMARK_INLINE void addTerms(const RowSums& s, const Lanes& t, std::array<Lanes, kSums>* sums) {
  const Lanes u = 1.0F - t;
  const Lanes c = t - 0.5F;
  const Lanes cc = c * c;
  const Lanes tt = t * t;
  const Lanes sl = s.ws - s.sd;  // l: the derivative by white
  const Lanes ld = s.wd - s.dd;
  const Lanes ll = s.w - s.wd - ld;
  const Lanes lb = s.wb - s.db;
  const Lanes lr = s.wr - s.dr;
  const CrossSums& m = s.beyond;
  const CrossSums& e = s.margin;
  const Lanes ml = m.one - m.dark;
  const Lanes el = e.one - e.dark;
  // Row by row. clang-format would fill the lines:
  // clang-format off
  const std::array<Lanes, kTerms> terms = {
      u * u * s.ss,                                                                   // start
      u * t * s.ss, t * t * s.ss,                                                     // end
      u * sl,       t * sl,       ll,                                                 // white
      u * s.sd,     t * s.sd,     ld,     s.dd,                                       // black
      u * s.sb,     t * s.sb,     lb,     s.db,     s.bb,                             // blur
      c * u * sl,   c * t * sl,   c * ll, c * ld,   c * lb,   cc * ll,                // slopes
      c * u * s.sd, c * t * s.sd, c * ld, c * s.dd, c * s.db, cc * ld, cc * s.dd,
      u * m.shift,  t * m.shift,  ml,     m.dark,   m.blur,   c * ml,  c * m.dark,    // behind
      m.beyond,
      u * e.shift,  t * e.shift,  el,     e.dark,   e.blur,   c * el,  c * e.dark,    // margin
      e.beyond,     s.margins,
      u * s.sr,     t * s.sr,     lr,     s.dr,     s.br,     c * lr,  c * s.dr,      // gradient
      m.residual,   e.residual,
      s.rr,         s.w,          tt * t * s.ss,    tt * tt * s.ss,    tt * s.sr};
  // clang-format on
#pragma GCC unroll 64
  for (std::size_t k = 0; k < kTerms; ++k) (*sums)[k] += terms[k];
}

// What the grey levels near an edge depend on, as floats.
using State = std::array<float, kUnknowns>;

// The samples of eight rows from `i` on. cut: squared residual at which a pixel's weight has fallen
// to a half (Cauchy's kernel).
WAYMARK_INLINE void sampleRows(const EdgeRows& rows, std::size_t i, const Neighbours& near,
                               const State& x, float cut, Samples* samples) {
  const float contrast = x[kBlack] - x[kWhite];
  const float per_cut = 1.0F / cut;
  const float per_blur = 1.0F / x[kBlur];
  const Lanes none{};
  const Lanes t = lanesAt(rows.t.data(), i);
  const Lanes white = x[kWhite] + x[kWhiteSlope] * (t - 0.5F);
  const Lanes black = x[kBlack] + x[kBlackSlope] * (t - 0.5F);
  const Lanes shift = x[kShiftStart] + t * (x[kShiftEnd] - x[kShiftStart]);
  const Lanes step = lanesAt(rows.step.data(), i);
  const Lanes innermost = lanesAt(rows.innermost.data(), i);
  const Lanes outermost = lanesAt(rows.outermost.data(), i);
  const Lanes thickness = lanesAt(rows.thickness.data(), i);
  const Lanes white_cell = lanesAt(rows.ring_white.data(), i);
  const float* const grey = rows.grey(i);
  Lanes distance = lanesAt(rows.distance.data(), i);
  Lanes to_start = lanesAt(rows.to_start.data(), i);
  Lanes to_end = lanesAt(rows.to_end.data(), i);
  for (std::size_t k = 0; k < rows.across(); ++k) {
    const Lanes place = (shift - distance) * per_blur;
    BlurredStep<Lanes> edge;
    blurredStepAt(place, &edge);
    Lanes dark = edge.height;
    Lanes by_shift = edge.slope;
    Lanes by_spread = edge.slope * place;
    if (near.ring) {  // the border ends where the cells begin, and moves with its edge
      const Lanes inner = place - thickness * per_blur;
      blurredStepAt(inner, &edge);
      dark -= white_cell * edge.height;
      by_shift -= white_cell * edge.slope;
      by_spread -= white_cell * edge.slope * inner;
    }
    Lanes factor = none + contrast * per_blur;
    if (near.start || near.end) {
      Lanes within = none + 1.0F;
      if (near.start) {
        blurredStepAt(to_start * per_blur, &edge);
        within *= edge.height;
      }
      if (near.end) {
        blurredStepAt(to_end * per_blur, &edge);
        within *= edge.height;
      }
      dark *= within;
      factor *= within;
    }
    Sample& sample = (*samples)[k];
    sample.dark = dark;
    sample.shift = by_shift * factor;
    sample.blur = -by_spread * factor;
    Lanes residual = white + dark * (black - white) - lanesAt(grey, k * kLanes);
    if (k >= near.margin_from && k < near.margin_to) {
      // The paper ends where its margin does, and moves with the edge.
      const Lanes outer = -place - (thickness + x[kMargin]) * per_blur;
      blurredStepAt(outer, &edge);
      residual += x[kBehind] * edge.height;
      sample.beyond = edge.height;
      sample.margin = -x[kBehind] * per_blur * edge.slope;
      sample.shift += sample.margin;
      sample.blur += sample.margin * outer;
    }
    const IntLanes counts = (distance >= innermost) & (distance <= outermost);
    const Lanes robust = 1.0F / (1.0F + residual * residual * per_cut);
    sample.residual = residual;
    sample.weight = counts ? robust : none;
    distance += step;
    to_start += rows.to_start_step;
    to_end += rows.to_end_step;
  }
}

// cut: as of sampleRows(). Precondition: there are rows.
WAYMARK_VECTORIZED void linearize(const EdgeRows& rows, const GroupNeighbours& neighbours,
                                  const State& x, float cut, NormalSums* normal) {
  std::array<Lanes, kSums> sums{};
  Samples samples;
  for (std::size_t i = 0; i < rows.rows(); i += kLanes) {
    const Neighbours& near = neighbours[i / kLanes];
    sampleRows(rows, i, near, x, cut, &samples);
    RowSums s;
    sumUp(samples.data(), samples.data() + rows.across(), &s);
    if (near.margin_from < near.margin_to) {
      const Sample* const from = samples.data() + near.margin_from;
      const Sample* const end = samples.data() + near.margin_to;
      sumUp(from, end, &Sample::beyond, &s.beyond);
      sumUp(from, end, &Sample::margin, &s.margin);
      for (const Sample* p = from; p != end; ++p) s.margins += p->weight * p->margin * p->margin;
    }
    addTerms(s, lanesAt(rows.t.data(), i), &sums);
  }
  for (std::size_t k = 0; k < kSums; k += kLanes) {
    sumEach({sums[k], sums[k + 1], sums[k + 2], sums[k + 3], sums[k + 4], sums[k + 5], sums[k + 6],
             sums[k + 7]},
            &lanesAt(normal->sums.data(), k));
  }
}

// The bow that the residuals of a straight edge show: of a shift a + b t + c t^2 the last.
void findBow(const NormalSums& normal, double variance, EdgeFit* fit) {
  const auto sum = [&](std::size_t k) { return static_cast<double>(normal.sums[k]); };
  const double start = sum(0);  // sums of u^2, u t and t^2, with u = 1 - t
  const double both = sum(1);
  const double end = sum(2);
  Eigen::Matrix3d M;
  M << start + 2.0 * both + end, both + end, end,  //
      both + end, end, sum(kThird),                //
      end, sum(kThird), sum(kFourth);
  const Eigen::Vector3d gradient(sum(kTriangle) + sum(kTriangle + 1), sum(kTriangle + 1),
                                 sum(kGradientSecond));
  Eigen::Matrix3d inverse;
  bool invertible = false;
  M.computeInverseWithCheck(inverse, invertible, 0.0);
  const double straight = start * end - both * both;
  if (!invertible || !inverse.allFinite() || !(straight > 0.0) || !(inverse(2, 2) > 0.0)) return;
  // The middle of c t^2 is c / 4 below its chord, and the step is against the gradient.
  fit->bow_px = 0.25 * inverse.row(2).dot(gradient);
  fit->bow_variance = variance * inverse(2, 2) / 16.0;
  fit->bent_variance =
      variance * Eigen::Vector2d(inverse(0, 0) - end / straight, inverse.sum() - start / straight);
}

// How many samples count.
WAYMARK_VECTORIZED int pixelsIn(const EdgeRows& rows) {
  IntLanes counted{};
  for (std::size_t i = 0; i < rows.rows(); i += kLanes) {
    const Lanes innermost = lanesAt(rows.innermost.data(), i);
    const Lanes outermost = lanesAt(rows.outermost.data(), i);
    Lanes distance = lanesAt(rows.distance.data(), i);
    for (std::size_t k = 0; k < rows.across(); ++k) {
      counted -= (distance >= innermost) & (distance <= outermost);  // true is -1
      distance += lanesAt(rows.step.data(), i);
    }
  }
  int pixels = 0;
  for (std::size_t lane = 0; lane < kLanes; ++lane) pixels += counted[lane];
  return pixels;
}

}  // namespace

std::string EdgeFitOptions::invalidReason() const {
  return firstUnmet({
      {iterations >= 1, "an edge fit needs at least 1 iteration"},
      {isPositive(min_blur_px) && max_blur_px >= min_blur_px,
       "the range of an edge's blur must be positive"},
      {isPositive(min_contrast), "the least contrast of an edge must be positive"},
      {isPositive(max_shift_px), "the largest shift of an edge must be positive"},
      {min_pixels >= 1, "an edge needs at least 1 pixel"},
      {isPositive(outlier_chi2), "the chi-square of an edge's outliers must be positive"},
      {isPositive(slope_sigma) && isPositive(blur_sigma_px) && isPositive(behind_sigma) &&
           isPositive(margin_sigma),
       "the sigmas of an edge's priors must be positive"},
  });
}

std::optional<EdgeFit> fitEdge(const EdgeRows& rows, const EdgeFit& start,
                               const EdgeFitOptions& options, double enough_px) {
  constexpr double kConverged = 0.02;    // pixels: the next step would be a quarter of it at most
  constexpr double kMaxStep = 1.5;       // pixels
  constexpr double kMostOfMargin = 0.8;  // by which it may be narrower or wider than the border
  constexpr double kRareMargin = 0.7;    // standard deviations beyond the usual ones, a share of it
  if (pixelsIn(rows) < options.min_pixels) return std::nullopt;
  const double border_px = rows.thickness[0];

  VectorU x;
  x << start.shift_start, start.shift_end, start.white, start.black, start.blur_px, 0.0, 0.0,
      start.behind, start.margin_px;
  constexpr double kMaxGrowth = 1.3;  // of the blur
  GroupNeighbours neighbours;
  findNeighbours(rows, static_cast<float>(kMaxGrowth * start.blur_px), &neighbours);
  MatrixU L;  // of the last iteration
  NormalSums sums;
  // Where the levels are guessed, nothing is an outlier yet.
  double variance = start.variance > 0.0 ? start.variance : 1e9;
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    const auto cut = static_cast<float>(options.outlier_chi2 * std::max(variance, 1.0));
    State xf;
    for (std::size_t i = 0; i < kUnknowns; ++i) {
      xf[i] = static_cast<float>(x[static_cast<Eigen::Index>(i)]);
    }
    linearize(rows, neighbours, xf, cut, &sums);
    MatrixU H = sums.matrix();
    VectorU g = sums.gradient();
    variance = sums.variance();
    const auto prior = [&](Unknown k, double mean, double sigma) {
      const double weight = variance / (sigma * sigma);
      H(k, k) += weight;
      g[k] += weight * (x[k] - mean);
    };
    prior(kBlur, start.blur_px, options.blur_sigma_px);
    prior(kWhiteSlope, 0.0, options.slope_sigma);
    prior(kBlackSlope, 0.0, options.slope_sigma);
    prior(kBehind, 0.0, options.behind_sigma);
    // Few margins are otherwise than most, but those by much.
    const double usual_px = options.margin_sigma * border_px;
    prior(kMargin, 0.0, std::hypot(usual_px, kRareMargin * x[kMargin]));

    L = H;
    if (!factorizeCholesky(&L)) return std::nullopt;
    VectorU step = solveCholesky(L, g);
    if (!step.allFinite()) return std::nullopt;
    for (const Unknown k : {kShiftStart, kShiftEnd}) {
      step[k] = std::clamp(step[k], -kMaxStep, kMaxStep);
    }
    x -= step;
    x[kBlur] = std::clamp(x[kBlur], options.min_blur_px, options.max_blur_px);
    x[kMargin] = std::clamp(x[kMargin], -kMostOfMargin * border_px, kMostOfMargin * border_px);
    const double shift = std::max(std::abs(x[kShiftStart]), std::abs(x[kShiftEnd]));
    if (shift > options.max_shift_px) return std::nullopt;
    if (iteration == 0 && start.variance <= 0.0) continue;
    const double moved = std::max(std::abs(step[kShiftStart]), std::abs(step[kShiftEnd]));
    if (moved < kConverged || shift >= enough_px) break;
  }
  if (x[kWhite] - x[kBlack] < options.min_contrast) return std::nullopt;
  EdgeFit fit{.shift_start = x[kShiftStart],
              .shift_end = x[kShiftEnd],
              .white = x[kWhite],
              .black = x[kBlack],
              .blur_px = x[kBlur],
              .behind = x[kBehind],
              .margin_px = x[kMargin],
              .variance = variance};
  fit.covariance.col(0) =
      variance * solveCholesky<kUnknowns>(L, VectorU::Unit(kShiftStart)).head<2>();
  fit.covariance.col(1) =
      variance * solveCholesky<kUnknowns>(L, VectorU::Unit(kShiftEnd)).head<2>();
  findBow(sums, variance, &fit);
  return fit;
}

}  // namespace waymark::slam
