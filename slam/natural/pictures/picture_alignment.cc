#include "slam/natural/pictures/picture_alignment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/reprojection.h"
#include "slam/natural/pictures/photometric_fit.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

constexpr double kStartBlur_px = 0.8;

// What an alignment is about.
struct Subject {
  const NaturalMarker& marker;
  const GreyPyramid& image;
  PixelRays* rays;
  const PictureAlignmentOptions& options;
};

// The unknowns on the way.
struct State {
  Transform T_c_p;
  Light light;
  double blur_px = kStartBlur_px;
};

std::vector<float> blurred(const ExpectedPicture& expected, double sigma_px) {
  cv::Mat in(expected.height, expected.width, CV_32F, const_cast<float*>(expected.grey.data()));
  std::vector<float> out(expected.grey.size());
  cv::Mat result(expected.height, expected.width, CV_32F, out.data());
  constexpr double kNothing_px = 0.15;  // narrower than a pixel can show
  if (sigma_px < kNothing_px) return expected.grey;
  cv::GaussianBlur(in, result, cv::Size(), sigma_px, sigma_px, cv::BORDER_REPLICATE);
  return out;
}

// What lies beyond the print's edge is not known: pixels that the blur reaches from there are not
// compared.
double insideFor(double blur_px) { return 0.5 + 2.0 * blur_px; }

// The expected image at the state's pose and blur.
std::optional<PhotometricFit> fitAt(const Subject& subject, const State& state, int level) {
  const double blur_px = state.blur_px / (1 << level);
  const int margin_px = 1 + static_cast<int>(std::ceil(4.0 * blur_px));
  const auto expected = expectPicture(subject.marker, state.T_c_p, level, margin_px, subject.rays);
  if (!expected) return std::nullopt;
  return PhotometricFit(*expected, blurred(*expected, blur_px), insideFor(blur_px), state.T_c_p,
                        subject.rays->camera(), subject.image.level(level));
}

// Levenberg-Marquardt at a fixed expected image, with a fixed cutoff.
void minimize(PhotometricFit* fit, int iterations, double cutoff, State* state) {
  constexpr double kConverged = 1e-7;  // relative fall of the cost
  constexpr double kHopeless = 1e6;
  double lambda = 1e-4;
  (void)fit->computeResiduals(state->T_c_p, state->light);
  double cost = fit->meanCost(cutoff);
  PhotometricMatrix A;
  PhotometricVector b;
  fit->normalEquations(state->light, cutoff, &A, &b);
  for (int i = 0; i < iterations && lambda < kHopeless; ++i) {
    PhotometricMatrix damped = A;
    damped.diagonal() *= 1.0 + lambda;
    damped.diagonal().array() += 1e-12;
    const PhotometricVector step = -damped.ldlt().solve(b);
    if (!step.allFinite()) return;
    State next = *state;
    next.T_c_p = state->T_c_p.retract(step.head<6>());
    next.light = {state->light.gain + step[6], state->light.offset + step[7],
                  state->light.slope_x + step[8], state->light.slope_y + step[9]};
    (void)fit->computeResiduals(next.T_c_p, next.light);
    const double next_cost = fit->meanCost(cutoff);
    if (next_cost > cost || next.light.gain <= 0.0) {
      lambda = std::max(10.0 * lambda, 1e-3);
      continue;
    }
    const bool converged = cost - next_cost <= kConverged * cost;
    *state = next;
    cost = next_cost;
    if (converged) break;
    lambda = std::max(0.1 * lambda, 1e-9);
    fit->normalEquations(state->light, cutoff, &A, &b);
  }
  (void)fit->computeResiduals(state->T_c_p, state->light);
}

double cutoffFor(const PhotometricFit& fit, const PictureAlignmentOptions& options) {
  return options.outlier_sigmas * std::max(options.min_noise, fit.robustSigma());
}

// One level: the expected image made and fitted, some times over. False when the picture is lost.
bool alignLevel(const Subject& subject, int level, int renders, bool start_light, State* state) {
  for (int i = 0; i < renders; ++i) {
    auto fit = fitAt(subject, *state, level);
    if (!fit || static_cast<int>(fit->pixels().size()) < subject.options.min_pixels / 4) {
      return false;
    }
    // Slopes belong to a box, gain and offset to the picture.
    if (start_light && i == 0) state->light = fit->fitLight(state->T_c_p);
    (void)fit->computeResiduals(state->T_c_p, state->light);
    minimize(&*fit, subject.options.iterations, cutoffFor(*fit, subject.options), state);
  }
  return true;
}

// The blur that explains the image best where the picture is now.
double bestBlur(const Subject& subject, const State& state, int level) {
  const double largest_px =
      *std::max_element(subject.options.blurs_px.begin(), subject.options.blurs_px.end());
  const double scale = 1.0 / (1 << level);
  const int margin_px = 1 + static_cast<int>(std::ceil(4.0 * largest_px * scale));
  const auto expected = expectPicture(subject.marker, state.T_c_p, level, margin_px, subject.rays);
  if (!expected) return state.blur_px;
  double best_px = state.blur_px;
  double least = -1.0;
  // The same pixels for all, or the widest blur would choose its own.
  const double inside_px = insideFor(state.blur_px * scale);
  for (const double blur_px : subject.options.blurs_px) {
    PhotometricFit fit(*expected, blurred(*expected, blur_px * scale), inside_px, state.T_c_p,
                       subject.rays->camera(), subject.image.level(level));
    const Light light = fit.fitLight(state.T_c_p);
    (void)fit.computeResiduals(state.T_c_p, light);
    const double sigma = fit.robustSigma();
    if (least < 0.0 || sigma < least) {
      least = sigma;
      best_px = blur_px;
    }
  }
  return best_px;
}

// Coarse to fine: first and last level.
struct Levels {
  int coarsest = 0;
  int finest = 0;
};

std::optional<Levels> levelsFor(const Subject& subject, const Transform& T_c_p) {
  const double area = coveredArea_px(subject.marker, T_c_p, subject.rays->camera());
  const double whole =
      static_cast<double>(subject.rays->camera().width()) * subject.rays->camera().height();
  double pixels = area > 0.0 ? std::min(area, whole) : whole;
  if (pixels < subject.options.min_pixels) return std::nullopt;
  const int last = subject.image.levels() - 1;
  Levels levels;
  while (pixels > subject.options.max_pixels && levels.finest < last) {
    pixels /= 4.0;
    ++levels.finest;
  }
  levels.coarsest = levels.finest;
  while (pixels / 4.0 >= subject.options.min_pixels && levels.coarsest < last &&
         levels.coarsest - levels.finest + 1 < subject.options.max_levels) {
    pixels /= 4.0;
    ++levels.coarsest;
  }
  return levels;
}

// Sums of a block of pixels.
struct Block {
  int count = 0;
  double e = 0.0, s = 0.0, ee = 0.0, ss = 0.0, es = 0.0;  // of expected and seen
  PhotometricVector score = PhotometricVector::Zero();    // sum of influence times Jacobian

  void add(double expected, double seen) {
    ++count;
    e += expected;
    s += seen;
    ee += expected * expected;
    ss += seen * seen;
    es += expected * seen;
  }
  void add(const Block& other) {
    count += other.count;
    e += other.e;
    s += other.s;
    ee += other.ee;
    ss += other.ss;
    es += other.es;
  }
  [[nodiscard]] double contrast() const {
    return std::sqrt(std::max(0.0, ee / count - e * e / count / count));
  }
  [[nodiscard]] double correlation() const {
    const double expected = ee - e * e / count;
    const double seen = ss - s * s / count;
    const double both = es - e * s / count;
    return expected > 0.0 && seen > 0.0 ? both / std::sqrt(expected * seen) : 0.0;
  }
};

// What the residuals at the end say, in sums.
struct Sums {
  std::map<std::pair<int, int>, Block> blocks;
  PhotometricMatrix JtJ = PhotometricMatrix::Zero();  // of pixels that have influence
  double influence2 = 0.0;                            // sum of the squared influences
  double slope = 0.0;                                 // and of the influence's derivatives
  double cut_square = 0.0;
  int with_influence = 0;
  int seen = 0;
};

Sums sumUp(const PhotometricFit& fit, const Light& light, double cutoff, int block_px) {
  Sums sums;
  for (std::size_t i = 0; i < fit.pixels().size(); ++i) {
    const PhotometricPixel& pixel = fit.pixels()[i];
    const double r = fit.residuals()[i];
    if (!std::isfinite(r)) continue;
    ++sums.seen;
    sums.cut_square += std::min(r * r, cutoff * cutoff);
    Block& block = sums.blocks[{pixel.row / block_px, pixel.column / block_px}];
    const double expected = light.gain * pixel.expected + light.offset + light.slope_x * pixel.x +
                            light.slope_y * pixel.y;
    block.add(expected, expected + r);
    const double t = r * r / (cutoff * cutoff);
    if (t >= 1.0) continue;
    const PhotometricVector row = fit.jacobian(i, light);
    const double influence = tukeyWeight(t) * r;
    block.score += influence * row;
    sums.JtJ.selfadjointView<Eigen::Lower>().rankUpdate(row);
    sums.influence2 += influence * influence;
    sums.slope += tukeySlope(t);
    ++sums.with_influence;
  }
  sums.JtJ = sums.JtJ.selfadjointView<Eigen::Lower>();
  return sums;
}

// Four corners, each off by the systematic error on its own.
std::optional<Matrix6d> systematicCovariance(const Subject& subject, const Transform& T_c_p) {
  const double focal_px = subject.rays->camera().focalLength();
  const double sigma = subject.options.systematic_sigma_px / focal_px;
  Matrix6d H = Matrix6d::Zero();
  for (const double x : {-0.5, 0.5}) {
    for (const double y : {-0.5, 0.5}) {
      const Eigen::Vector3d p =
          T_c_p * Eigen::Vector3d(x * subject.marker.width_m(), y * subject.marker.height_m(), 0.0);
      if (p.z() < kNearestDepth) return std::nullopt;
      const Matrix26d J = markerJacobian(T_c_p, p, projectionJacobian(Transform{}, p)) / sigma;
      H += J.transpose() * J;
    }
  }
  return inverseOf(H);
}

// The M-estimator's covariance, widened by what the residuals of a block have in common. Fills
// covariance and dependence. False when the pose is not held.
bool fillCovariance(const Subject& subject, const Sums& sums, PictureAlignment* result) {
  const int free = sums.with_influence - kPhotometricUnknowns;
  if (free <= 0 || !(sums.slope > 0.0)) return false;
  const Eigen::LDLT<PhotometricMatrix> factor(sums.JtJ);
  if (factor.info() != Eigen::Success || !factor.isPositive()) return false;
  const PhotometricMatrix inverse = factor.solve(PhotometricMatrix::Identity());
  const double n = sums.with_influence;
  // Influence squared over slope squared: the variance of a residual's worth, for JtJ's inverse.
  const double variance = std::max(subject.options.min_noise * subject.options.min_noise,
                                   sums.influence2 * n / (sums.slope * sums.slope) * n / free);
  const Matrix6d white = inverse.topLeftCorner<6, 6>();

  // Sandwich of the blocks' scores, against what independent residuals would make of it.
  Matrix6d dependent = Matrix6d::Zero();
  for (const auto& [place, block] : sums.blocks) {
    const Vector6d v = (inverse * block.score).head<6>();
    dependent += v * v.transpose();
  }
  const double mean_influence2 = sums.influence2 / n;
  const auto blocks = static_cast<double>(sums.blocks.size());
  const double correction =
      blocks > 2.0 * kPhotometricUnknowns ? blocks / (blocks - kPhotometricUnknowns) : 2.0;
  const double trace = white.ldlt().solve(dependent).trace();
  result->dependence = std::max(1.0, correction * trace / (6.0 * mean_influence2));
  const auto systematic = systematicCovariance(subject, result->T_c_p);
  if (!systematic) return false;
  result->covariance = result->dependence * variance * white + *systematic;
  return result->covariance.allFinite();
}

// Fills what verifies the picture.
void judge(const Subject& subject, const PhotometricFit& fit, const Sums& sums, int level,
           PictureAlignment* result) {
  constexpr int kLeastPixels = 16;  // of a block
  Block agreeing;
  int agreed = 0;
  for (const auto& [place, block] : sums.blocks) {
    if (block.count < kLeastPixels) continue;
    if (block.contrast() < subject.options.block_contrast) continue;
    ++result->textured_blocks;
    if (block.correlation() < subject.options.block_correlation) continue;
    ++agreed;
    agreeing.add(block);
  }
  if (result->textured_blocks > 0) {
    result->agreeing_share = static_cast<double>(agreed) / result->textured_blocks;
  }
  if (agreeing.count > 0) result->correlation = agreeing.correlation();
  const double covered = coveredArea_px(subject.marker, result->T_c_p, subject.rays->camera());
  const double seen = static_cast<double>(fit.pixels().size()) * (1 << level) * (1 << level);
  result->in_image = covered > 0.0 ? std::min(1.0, seen / covered) : 1.0;
}

}  // namespace

std::string PictureAlignmentOptions::invalidReason() const {
  const bool blurs =
      !blurs_px.empty() && std::all_of(blurs_px.begin(), blurs_px.end(),
                                       [](double blur) { return blur > 0.0 && blur <= 20.0; });
  return firstUnmet({
      {max_pixels >= 500, "an alignment needs at least 500 pixels"},
      {min_pixels >= 50 && min_pixels <= max_pixels, "an alignment's least pixels are 50 at least"},
      {max_levels >= 1, "an alignment needs at least 1 level"},
      {renders >= 1 && iterations >= 1, "an alignment needs at least 1 step"},
      {isPositive(outlier_sigmas), "the outliers' limit must be positive"},
      {isPositive(min_noise), "the image's least noise must be positive"},
      {blurs, "the lens's blurs are from 0 to 20 pixels, and at least one"},
      {isPositive(systematic_sigma_px), "the systematic error of a picture must be positive"},
      {block_px >= 2, "a block has at least 2 pixels a side"},
      {isNotNegative(block_contrast), "a block's contrast must not be negative"},
      {isShare(block_correlation), "a block's correlation is from 0 to 1"},
  });
}

std::optional<PictureAlignment> alignPicture(const NaturalMarker& marker, const GreyPyramid& image,
                                             const Transform& start, PixelRays* rays,
                                             const PictureAlignmentOptions& options) {
  const Subject subject{marker, image, rays, options};
  const auto levels = levelsFor(subject, start);
  if (!levels) return std::nullopt;
  State state{start, {}, kStartBlur_px};
  for (int level = levels->coarsest; level >= levels->finest; --level) {
    const bool first = level == levels->coarsest;
    if (!alignLevel(subject, level, first ? options.renders : 1, first, &state)) {
      return std::nullopt;
    }
    // Slopes are told by the box, which the next level has another one of.
    state.light.slope_x = state.light.slope_y = 0.0;
  }
  state.blur_px = bestBlur(subject, state, levels->finest);
  if (!alignLevel(subject, levels->finest, options.renders, true, &state)) return std::nullopt;

  // The last word: expected and seen at one and the same pose, no pixel moved.
  auto fit = fitAt(subject, state, levels->finest);
  if (!fit) return std::nullopt;
  if (static_cast<int>(fit->pixels().size()) < options.min_pixels / 4) return std::nullopt;
  (void)fit->computeResiduals(state.T_c_p, state.light);
  const double cutoff = cutoffFor(*fit, options);
  minimize(&*fit, 2, cutoff, &state);
  const Sums sums = sumUp(*fit, state.light, cutoff, options.block_px);
  if (sums.seen == 0) return std::nullopt;
  PictureAlignment result;
  result.T_c_p = state.T_c_p;
  result.noise = cutoff / options.outlier_sigmas;
  result.blur_px = state.blur_px;
  result.pixels = sums.seen;
  result.cut_square = sums.cut_square / sums.seen;
  if (!fillCovariance(subject, sums, &result)) return std::nullopt;
  judge(subject, *fit, sums, levels->finest, &result);
  return result;
}

double evidenceAgainst(const PictureAlignment& rival, const PictureAlignment& best,
                       const PictureAlignmentOptions& options) {
  const double noise = std::max(options.min_noise, best.noise);
  const double worse = std::max(0.0, rival.cut_square - best.cut_square);
  return best.pixels * worse / (noise * noise) / best.dependence;
}

}  // namespace waymark::slam
