#include "slam/detection/edges/edge_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

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
constexpr std::size_t kSums = (kGradientSecond + kLanes) / kLanes * kLanes;  // the last are none

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

// blur_px: the largest that is to be reckoned with.
void findNeighbours(const EdgeRows& rows, float blur_px, GroupNeighbours* groups) {
  // So far within the paper, in standard deviations of the blur, what is behind it is not seen, and
  // so narrow, as a share of the border, a margin may be.
  constexpr float kBehindReach = 2.0F;
  constexpr float kNarrowMargin = 0.7F;
  const float reach = kBlurReach * blur_px;
  const auto last = static_cast<float>(rows.across() - 1);
  for (std::size_t first = 0; first < rows.rows(); first += kLanes) {
    Neighbours& group = (*groups)[first / kLanes];
    group = {
        .start = false, .end = false, .ring = false, .margin_from = rows.across(), .margin_to = 0};
    for (std::size_t i = first; i < first + kLanes; ++i) {
      if (rows.innermost[i] > rows.outermost[i]) continue;  // nothing counts
      group.start |= rows.to_start[i] + std::min(0.0F, last * rows.to_start_step) < reach;
      group.end |= rows.to_end[i] + std::min(0.0F, last * rows.to_end_step) < reach;
      group.ring |= rows.ring_white[i] > 0.0F && rows.thickness[i] + rows.innermost[i] < reach;
      const float paper = kNarrowMargin * rows.thickness[i] - kBehindReach * blur_px;
      if (rows.outermost[i] <= paper) continue;
      const float to_paper = (paper - rows.distance[i]) / rows.step[i];  // samples
      const auto at = static_cast<std::size_t>(std::clamp(to_paper, 0.0F, last));
      if (rows.step[i] > 0.0F) {
        group.margin_from = std::min(group.margin_from, at);
        group.margin_to = rows.across();
      } else {
        group.margin_from = 0;
        group.margin_to = std::max(group.margin_to, at + 1);
      }
    }
  }
}

// A sample's derivatives by shift, white, black, blur, what is behind the paper, and where it ends.
struct Derivatives {
  Lanes shift, light, dark, blur;
  Lanes beyond{}, margin{};
};

// What one derivative has in common with the others and the residual, summed over samples.
struct CrossSums {
  Lanes shift{}, light{}, dark{}, blur{}, beyond{}, residual{};

  // weighted: the derivative, times the sample's weight.
  WAYMARK_INLINE void add(const Lanes& weighted, const Derivatives& by, const Lanes& r) {
    shift += weighted * by.shift;
    light += weighted * by.light;
    dark += weighted * by.dark;
    blur += weighted * by.blur;
    beyond += weighted * by.beyond;
    residual += weighted * r;
  }
};

// Sums over the samples of eight rows: what the normal equations are made of. s, l, d and b are the
// derivatives by shift, white, black and blur; r is the residual.
struct RowSums {
  Lanes ss{}, sl{}, sd{}, sb{}, ll{}, ld{}, dd{}, lb{}, db{}, bb{};
  Lanes sr{}, lr{}, dr{}, br{};
  Lanes rr{}, weights{};
  CrossSums beyond, margin;
  Lanes margins{};  // by margin, squared

  WAYMARK_INLINE void add(const Derivatives& by, const Lanes& residual, const Lanes& weight) {
    const Lanes ws = weight * by.shift;
    const Lanes wl = weight * by.light;
    const Lanes wd = weight * by.dark;
    const Lanes wb = weight * by.blur;
    ss += ws * by.shift;
    sl += ws * by.light;
    sd += ws * by.dark;
    sb += ws * by.blur;
    ll += wl * by.light;
    ld += wl * by.dark;
    dd += wd * by.dark;
    lb += wl * by.blur;
    db += wd * by.blur;
    bb += wb * by.blur;
    sr += ws * residual;
    lr += wl * residual;
    dr += wd * residual;
    br += wb * residual;
    rr += weight * residual * residual;
    weights += weight;
  }
  // In addition, near the end of the paper.
  WAYMARK_INLINE void addMargin(const Derivatives& by, const Lanes& residual, const Lanes& weight) {
    const Lanes weighted = weight * by.margin;
    beyond.add(weight * by.beyond, by, residual);
    margin.add(weighted, by, residual);
    margins += weighted * by.margin;
  }
};

// The terms of NormalSums that eight rows add, each row's t put in.
WAYMARK_INLINE void termsOf(const RowSums& s, const Lanes& t, std::array<Lanes, kSums>* terms) {
  const Lanes u = 1.0F - t;
  const Lanes c = t - 0.5F;
  const Lanes cc = c * c;
  const Lanes tt = t * t;
  const CrossSums& m = s.beyond;
  const CrossSums& e = s.margin;
  *terms = {
      u * u * s.ss,                                                                    // start
      u * t * s.ss, t * t * s.ss,                                                      // end
      u * s.sl,     t * s.sl,     s.ll,                                                // white
      u * s.sd,     t * s.sd,     s.ld,          s.dd,                                 // black
      u * s.sb,     t * s.sb,     s.lb,          s.db,           s.bb,                 // blur
      c * u * s.sl, c * t * s.sl, c * s.ll,      c * s.ld,       c * s.lb, cc * s.ll,  // slopes
      c * u * s.sd, c * t * s.sd, c * s.ld,      c * s.dd,       c * s.db, cc * s.ld,
      cc * s.dd,                                                                         //
      u * m.shift,  t * m.shift,  m.light,       m.dark,         m.blur,   c * m.light,  // behind
      c * m.dark,   m.beyond,                                                            //
      u * e.shift,  t * e.shift,  e.light,       e.dark,         e.blur,   c * e.light,  // margin
      c * e.dark,   e.beyond,     s.margins,                                             //
      u * s.sr,     t * s.sr,     s.lr,          s.dr,           s.br,     c * s.lr,     // gradient
      c * s.dr,     m.residual,   e.residual,                                            //
      s.rr,         s.weights,    tt * t * s.ss, tt * tt * s.ss,                         //
      tt * s.sr};
}

// cut: squared residual at which a pixel's weight has fallen to a half (Cauchy's kernel).
// Precondition: there are rows.
WAYMARK_VECTORIZED void linearize(const EdgeRows& rows, const GroupNeighbours& neighbours,
                                  const std::array<float, kUnknowns>& x, float cut,
                                  NormalSums* normal) {
  const float contrast = x[kBlack] - x[kWhite];
  const float per_cut = 1.0F / cut;
  const float per_blur = 1.0F / x[kBlur];
  const float behind = x[kBehind];
  const float margin = x[kMargin];
  const Lanes none{};
  std::array<Lanes, kSums> sums;
  for (std::size_t i = 0; i < rows.rows(); i += kLanes) {
    const Neighbours& near = neighbours[i / kLanes];
    const Lanes t = lanesAt(rows.t.data(), i);
    const Lanes white = x[kWhite] + x[kWhiteSlope] * (t - 0.5F);
    const Lanes black = x[kBlack] + x[kBlackSlope] * (t - 0.5F);
    const Lanes shift = x[kShiftStart] + t * (x[kShiftEnd] - x[kShiftStart]);
    const Lanes step = lanesAt(rows.step.data(), i);
    const Lanes innermost = lanesAt(rows.innermost.data(), i);
    const Lanes outermost = lanesAt(rows.outermost.data(), i);
    const float* const grey = rows.grey(i);
    Lanes distance = lanesAt(rows.distance.data(), i);
    Lanes to_start = lanesAt(rows.to_start.data(), i);
    Lanes to_end = lanesAt(rows.to_end.data(), i);
    RowSums s;
    for (std::size_t k = 0; k < rows.across(); ++k) {
      const Lanes place = (shift - distance) * per_blur;
      BlurredStep<Lanes> edge;
      blurredStepAt(place, &edge);
      Lanes dark = edge.height;
      Lanes by_shift = edge.slope;
      Lanes by_spread = edge.slope * place;
      if (near.ring) {  // the border ends where the cells begin, and moves with its edge
        const Lanes inner = place - lanesAt(rows.thickness.data(), i) * per_blur;
        const Lanes white_cell = lanesAt(rows.ring_white.data(), i);
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
      const Lanes light = 1.0F - dark;
      Derivatives by{by_shift * factor, light, dark, -by_spread * factor};
      Lanes residual = light * white + dark * black - lanesAt(grey, k * kLanes);
      const bool near_margin = k >= near.margin_from && k < near.margin_to;
      if (near_margin) {  // the paper ends where its margin does, and moves with the edge
        const Lanes outer = -place - (lanesAt(rows.thickness.data(), i) + margin) * per_blur;
        blurredStepAt(outer, &edge);
        residual += behind * edge.height;
        by.beyond = edge.height;
        by.margin = -behind * per_blur * edge.slope;
        by.shift += by.margin;
        by.blur += by.margin * outer;
      }
      const IntLanes counts = (distance >= innermost) & (distance <= outermost);
      const Lanes robust = 1.0F / (1.0F + residual * residual * per_cut);
      const Lanes weight = counts ? robust : none;
      s.add(by, residual, weight);
      if (near_margin) s.addMargin(by, residual, weight);
      distance += step;
      to_start += rows.to_start_step;
      to_end += rows.to_end_step;
    }
    std::array<Lanes, kSums> terms;
    termsOf(s, t, i == 0 ? &sums : &terms);
    if (i == 0) continue;
    for (std::size_t k = 0; k < kSums; ++k) sums[k] += terms[k];
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
                               const EdgeFitOptions& options) {
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
    std::array<float, kUnknowns> xf;
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
    if (std::max(std::abs(x[kShiftStart]), std::abs(x[kShiftEnd])) > options.max_shift_px) {
      return std::nullopt;
    }
    const double moved = std::max(std::abs(step[kShiftStart]), std::abs(step[kShiftEnd]));
    if ((iteration > 0 || start.variance > 0.0) && moved < kConverged) break;
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
