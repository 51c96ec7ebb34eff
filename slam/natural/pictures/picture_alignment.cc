#include "slam/natural/pictures/picture_alignment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/reprojection.h"
#include "slam/natural/pictures/block_matches.h"
#include "slam/natural/pictures/photometric_fit.h"
#include "slam/natural/pictures/picture_blur.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

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
  Light light = Light::Zero();
  Eigen::Matrix2d blur = Eigen::Matrix2d::Zero();  // covariance, pixels squared of full size
};

// What lies beyond the print's edge is not known: pixels that the blur reaches from there are not
// compared.
double insideFor(const Eigen::Matrix2d& blur) { return 0.5 + 2.0 * widestBlur(blur); }

Eigen::Matrix2d atLevel(const Eigen::Matrix2d& blur, int level) {
  return blur / static_cast<double>(1 << (2 * level));
}

std::optional<ExpectedPicture> expectAt(const Subject& subject, const State& state, int level,
                                        double most_sigma_px) {
  const int margin_px = 1 + static_cast<int>(std::ceil(3.0 * most_sigma_px / (1 << level)));
  return expectPicture(subject.marker, state.T_c_p, level, margin_px, subject.rays);
}

PhotometricFit fitOf(const Subject& subject, const ExpectedPicture& expected, const State& state) {
  const Eigen::Matrix2d blur = atLevel(state.blur, expected.level);
  return PhotometricFit(expected, blurredPicture(expected, blur), insideFor(blur), state.T_c_p,
                        subject.rays->camera(), subject.image.level(expected.level));
}

// The expected image at the state's pose and blur.
std::optional<PhotometricFit> fitAt(const Subject& subject, const State& state, int level) {
  const auto expected = expectAt(subject, state, level, widestBlur(state.blur));
  if (!expected) return std::nullopt;
  PhotometricFit fit = fitOf(subject, *expected, state);
  if (static_cast<int>(fit.pixels().size()) < subject.options.min_pixels / 4) return std::nullopt;
  return fit;
}

// Levenberg-Marquardt at a fixed expected image, with a fixed cutoff.
void minimize(PhotometricFit* fit, int iterations, double cutoff, State* state) {
  constexpr double kConverged = 1e-7;  // relative fall of the cost
  constexpr double kHopeless = 1e6;
  double lambda = 1e-4;
  fit->computeResiduals(state->T_c_p, state->light);
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
    next.light = state->light + step.tail<7>();
    fit->computeResiduals(next.T_c_p, next.light);
    const double next_cost = fit->meanCost(cutoff);
    if (next_cost > cost || next.light[1] <= 0.0) {
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
  fit->computeResiduals(state->T_c_p, state->light);
}

double cutoffFor(const PhotometricFit& fit, const PictureAlignmentOptions& options) {
  return options.outlier_sigmas * std::max(options.min_noise, fit.robustSigma());
}

// Light from what is not hidden; residuals are those of the state then.
void prepare(const Subject& subject, double visible_correlation, PhotometricFit* fit,
             State* state) {
  fit->leaveOutHidden(state->T_c_p, subject.options.block_px, subject.options.block_contrast,
                      visible_correlation);
  state->light = fit->fitLight(state->T_c_p, subject.options.outlier_sigmas);
}

// One level: the expected image made and fitted, some times over. False when the picture is lost.
bool alignLevel(const Subject& subject, int level, int renders, double visible_correlation,
                State* state) {
  for (int i = 0; i < renders; ++i) {
    auto fit = fitAt(subject, *state, level);
    if (!fit) return false;
    prepare(subject, visible_correlation, &*fit, state);
    minimize(&*fit, subject.options.iterations, cutoffFor(*fit, subject.options), state);
  }
  return true;
}

// Whether hardly anything in the image looks like the picture: then it is not there, and a closer
// look is time lost.
bool isHopeless(const Subject& subject, const State& state, int level) {
  auto fit = fitAt(subject, state, level);
  if (!fit) return true;
  const PictureAlignmentOptions& options = subject.options;
  int textured = 0;
  int agreed = 0;
  for (const auto& [place, block] : fit->blocks(state.T_c_p, options.block_px)) {
    if (block.contrast() < options.block_contrast) continue;
    ++textured;
    if (block.correlation() >= options.block_correlation) ++agreed;
  }
  return agreed < options.hopeless_share * textured;
}

// The blur that explains the image best where the picture is now: the best round one, then made
// narrower or wider in each direction until it fits.
void fitBlur(const Subject& subject, int level, State* state) {
  constexpr int kRounds = 4;
  const PictureAlignmentOptions& options = subject.options;
  const double most_px = *std::max_element(options.blurs_px.begin(), options.blurs_px.end());
  const auto expected = expectAt(subject, *state, level, most_px);
  if (!expected) return;
  State best = *state;
  double least = -1.0;
  for (const double blur_px : options.blurs_px) {
    State candidate = *state;
    candidate.blur = blur_px * blur_px * Eigen::Matrix2d::Identity();
    PhotometricFit fit = fitOf(subject, *expected, candidate);
    if (static_cast<int>(fit.pixels().size()) < options.min_pixels / 4) break;
    prepare(subject, options.block_correlation, &fit, &candidate);
    const double sigma = fit.robustSigma();
    if (least >= 0.0 && sigma >= least) continue;
    least = sigma;
    best = candidate;
  }
  for (int i = 0; i < kRounds; ++i) {
    PhotometricFit fit = fitOf(subject, *expected, best);
    prepare(subject, options.block_correlation, &fit, &best);
    const Eigen::Vector3d step =
        (1 << (2 * level)) * fit.blurStep(best.light, cutoffFor(fit, options));
    Eigen::Matrix2d change;
    change << step[0], step[1], step[1], step[2];
    // A step holds for blurs that are not much wider than the one it was taken at.
    const double scale = std::min(1.0, 0.5 * best.blur.trace() / std::max(1e-9, change.norm()));
    best.blur = limitedBlur(best.blur + scale * change, options.blurs_px.front(), most_px);
  }
  *state = best;
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

// What the residuals at the end say, in sums.
struct Sums {
  std::map<BlockPlace, PhotometricVector> scores;     // of blocks: influence times Jacobian
  PhotometricMatrix JtJ = PhotometricMatrix::Zero();  // of pixels that have influence
  double influence2 = 0.0;                            // sum of the squared influences
  double slope = 0.0;                                 // and of the influence's derivatives
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
    const double t = r * r / (cutoff * cutoff);
    if (t >= 1.0) continue;
    const PhotometricVector row = fit.jacobian(i, light);
    const double influence = tukeyWeight(t) * r;
    const auto [score, added] =
        sums.scores.try_emplace(blockOf(pixel, block_px), PhotometricVector::Zero());
    score->second += influence * row;
    sums.JtJ.selfadjointView<Eigen::Lower>().rankUpdate(row);
    sums.influence2 += influence * influence;
    sums.slope += tukeySlope(t);
    ++sums.with_influence;
  }
  sums.JtJ = sums.JtJ.selfadjointView<Eigen::Lower>();
  return sums;
}

// Mean of the squared residuals, each cut off; also of what hides the picture, so that of two
// pictures none gains by calling hidden what contradicts it.
double meanCutSquare(const PhotometricFit& fit, double cutoff) {
  double sum = 0.0;
  int seen = 0;
  for (const float r : fit.residuals()) {
    if (!std::isfinite(r)) continue;
    sum += std::min(static_cast<double>(r) * r, cutoff * cutoff);
    ++seen;
  }
  return seen > 0 ? sum / seen : cutoff * cutoff;
}

// What the pixels of a corner have in common, pixels of the image.
double systematicSigma_px(const PictureAlignmentOptions& options, double blur_px, int level) {
  const double sampling_px = options.systematic_sigma_px * (1 << level);
  const double streak_px = options.blur_sigma_per_px2 * blur_px * blur_px;
  return std::hypot(sampling_px, streak_px);
}

std::array<Eigen::Vector3d, 4> printCorners(const NaturalMarker& marker) {
  const double x = 0.5 * marker.width_m();
  const double y = 0.5 * marker.height_m();
  return {{{-x, -y, 0.0}, {-x, y, 0.0}, {x, -y, 0.0}, {x, y, 0.0}}};
}

// Four corners, each off by the systematic error on its own.
std::optional<Matrix6d> systematicCovariance(const Subject& subject, const Transform& T_c_p,
                                             double sigma_px) {
  const double sigma = sigma_px / subject.rays->camera().focalLength();
  Matrix6d H = Matrix6d::Zero();
  for (const Eigen::Vector3d& corner : printCorners(subject.marker)) {
    const Eigen::Vector3d p = T_c_p * corner;
    if (p.z() < kNearestDepth) return std::nullopt;
    const Matrix26d J = markerJacobian(T_c_p, p, projectionJacobian(Transform{}, p)) / sigma;
    H += J.transpose() * J;
  }
  return inverseOf(H);
}

// The M-estimator's covariance, widened by what the residuals of a block have in common. Fills
// covariance and dependence. False when the pose is not held.
bool fillCovariance(const Subject& subject, const Sums& sums, int level, PictureAlignment* result) {
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
  for (const auto& [place, score] : sums.scores) {
    const Vector6d v = (inverse * score).head<6>();
    dependent += v * v.transpose();
  }
  const double mean_influence2 = sums.influence2 / n;
  const auto blocks = static_cast<double>(sums.scores.size());
  const double correction =
      blocks > 2.0 * kPhotometricUnknowns ? blocks / (blocks - kPhotometricUnknowns) : 2.0;
  const double trace = white.ldlt().solve(dependent).trace();
  result->dependence = std::max(1.0, correction * trace / (6.0 * mean_influence2));
  result->systematic_px = systematicSigma_px(subject.options, result->blur_px, level);
  const auto systematic = systematicCovariance(subject, result->T_c_p, result->systematic_px);
  if (!systematic) return false;
  result->covariance = result->dependence * variance * white + *systematic;
  return result->covariance.allFinite();
}

// Fills what verifies the picture, of all its pixels.
void judge(const Subject& subject, PhotometricFit whole, int level, PictureAlignment* result) {
  PixelBlock agreeing;
  std::vector<double> correlations;  // of these, one by one
  for (const auto& [place, block] : whole.blocks(result->T_c_p, subject.options.block_px)) {
    if (block.count < kLeastBlockPixels) continue;
    if (block.contrast() < subject.options.block_contrast) continue;
    ++result->textured_blocks;
    if (block.correlation() < subject.options.block_correlation) continue;
    correlations.push_back(block.correlation());
    agreeing.add(block);
  }
  if (result->textured_blocks > 0) {
    result->agreeing_share = static_cast<double>(correlations.size()) / result->textured_blocks;
  }
  if (!correlations.empty()) {
    const auto middle = correlations.begin() + static_cast<std::ptrdiff_t>(correlations.size() / 2);
    std::ranges::nth_element(correlations, middle);
    result->block_correlation = *middle;
  }
  result->correlation = agreeing.correlation();
  const double covered = coveredArea_px(subject.marker, result->T_c_p, subject.rays->camera());
  const double seen = static_cast<double>(whole.pixels().size()) * (1 << level) * (1 << level);
  result->in_image = covered > 0.0 ? std::min(1.0, seen / covered) : 1.0;
}

// From a state near the end: the last fit, and what it is worth.
std::optional<PictureAlignment> conclude(const Subject& subject, int level, State* state) {
  const PictureAlignmentOptions& options = subject.options;
  if (!alignLevel(subject, level, options.renders, options.block_correlation, state)) {
    return std::nullopt;
  }
  // The last word: expected and seen at one and the same pose, no pixel moved.
  auto whole = fitAt(subject, *state, level);
  if (!whole) return std::nullopt;
  PhotometricFit fit = *whole;
  prepare(subject, options.block_correlation, &fit, state);
  const double cutoff = cutoffFor(fit, options);
  minimize(&fit, 2, cutoff, state);
  const Sums sums = sumUp(fit, state->light, cutoff, options.block_px);
  if (sums.seen == 0) return std::nullopt;
  PictureAlignment result;
  result.T_c_p = state->T_c_p;
  result.noise = cutoff / options.outlier_sigmas;
  result.blur_px = widestBlur(state->blur);
  result.pixels = sums.seen;
  whole->computeResiduals(state->T_c_p, state->light);
  result.cut_square = meanCutSquare(*whole, cutoff);
  if (!fillCovariance(subject, sums, level, &result)) return std::nullopt;
  judge(subject, std::move(*whole), level, &result);
  return result;
}

// The pose from which the blocks are where the image has them, in the same blur. Empty where too
// few are anywhere.
std::optional<State> rematched(const Subject& subject, int level, const State& state) {
  constexpr double kKernel_px = 1.0;  // whole pixels, and the picture's perspective
  constexpr std::size_t kLeastBlocks = 8;
  const CameraModel& camera = subject.rays->camera();
  const auto fit = fitAt(subject, state, level);
  if (!fit) return std::nullopt;
  const BlockMatchOptions options{.block_px = subject.options.block_px,
                                  .reach_px = subject.options.rematch_reach_px,
                                  .contrast = subject.options.block_contrast,
                                  .correlation = subject.options.rematch_correlation};
  const std::vector<PrintPoint> found =
      matchBlocks(fit->pixels(), subject.image.level(level), level, camera, options);
  if (found.size() < kLeastBlocks) return std::nullopt;
  const auto pose =
      poseFromPoints(state.T_c_p, found, camera.focalLength(), kKernel_px * (1 << level));
  if (!pose) return std::nullopt;
  State moved = state;
  moved.T_c_p = pose->T;
  return moved;
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
      {isNotNegative(blur_sigma_per_px2), "the error of a blur must not be negative"},
      {block_px >= 2, "a block has at least 2 pixels a side"},
      {isNotNegative(block_contrast), "a block's contrast must not be negative"},
      {isShare(block_correlation), "a block's correlation is from 0 to 1"},
      {isShare(hopeless_share), "the share of blocks without which there is no hope is 0 to 1"},
      {isShare(rematch_share) && isShare(rematch_correlation),
       "what makes an alignment look for its blocks is from 0 to 1"},
      {rematch_reach_px >= 1 && rematch_reach_px <= 20,
       "a block is looked for 1 to 20 pixels away"},
  });
}

std::optional<PictureAlignment> alignPicture(const NaturalMarker& marker, const GreyPyramid& image,
                                             const Transform& start, PixelRays* rays,
                                             const PictureAlignmentOptions& options) {
  const Subject subject{marker, image, rays, options};
  const auto levels = levelsFor(subject, start);
  if (!levels) return std::nullopt;
  // A camera in focus; of the levels above the finest the blur matters little.
  constexpr double kStartBlur_px = 0.8;
  State state{.T_c_p = start, .blur = kStartBlur_px * kStartBlur_px * Eigen::Matrix2d::Identity()};
  // What is not yet in its place agrees less.
  double visible = 0.5 * options.block_correlation;
  for (int level = levels->coarsest; level >= levels->finest; --level) {
    const int renders = level == levels->coarsest ? options.renders : 1;
    if (!alignLevel(subject, level, renders, visible, &state)) return std::nullopt;
    visible = options.block_correlation;
  }
  if (isHopeless(subject, state, levels->finest)) return std::nullopt;
  fitBlur(subject, levels->finest, &state);
  const auto result = conclude(subject, levels->finest, &state);
  if (!result || result->agreeing_share >= options.rematch_share) return result;
  // Part of it is hidden, or the fit is held by half of it in a wrong place.
  auto moved = rematched(subject, levels->finest, state);
  if (!moved) return result;
  const auto again = conclude(subject, levels->finest, &*moved);
  return again && again->agreeingBlocks() > result->agreeingBlocks() ? again : result;
}

double evidenceAgainst(const PictureAlignment& rival, const PictureAlignment& best,
                       const PictureAlignmentOptions& options) {
  const double noise = std::max(options.min_noise, best.noise);
  const double worse = std::max(0.0, rival.cut_square - best.cut_square);
  return best.pixels * worse / (noise * noise) / best.dependence;
}

double evidenceAgainstPose(const NaturalMarker& marker, const CameraModel& camera,
                           const PictureAlignment& rival, const PictureAlignment& best,
                           const PictureAlignmentOptions& options) {
  const double of_pixels = evidenceAgainst(rival, best, options);
  double apart_px2 = 0.0;
  for (const Eigen::Vector3d& corner : printCorners(marker)) {
    const auto a = camera.project(rival.T_c_p * corner);
    const auto b = camera.project(best.T_c_p * corner);
    if (!a || !b) return of_pixels;  // so near that nothing is ambiguous
    apart_px2 += (*a - *b).squaredNorm();
  }
  const double of_corners = apart_px2 / (best.systematic_px * best.systematic_px);
  // The way from one to the other is known as well as both errors together leave it.
  return of_pixels > 0.0 && of_corners > 0.0 ? of_pixels * of_corners / (of_pixels + of_corners)
                                             : 0.0;
}

}  // namespace waymark::slam
