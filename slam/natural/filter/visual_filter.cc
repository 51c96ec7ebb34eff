#include "slam/natural/filter/visual_filter.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/LU>

#include "slam/natural/filter/point_view.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// How near the image's border, in pixels, features are looked for, and new ones are put.
constexpr double kSearchBorder_px = 6.0;
constexpr int kNewBorder_px = 12;
// New features are looked for where the image is about as wide as this, pixels.
constexpr int kCornerImageWidth_px = 400;
// Parts of the image for each feature there may be: some have no texture.
constexpr double kPartsPerFeature = 1.5;
// An inverse depth is known well when its sigma is this share of it.
constexpr double kWellKnown = 0.15;
// Nothing is nearer than this, metres.
constexpr double kNearest_m = 0.05;

}  // namespace

std::string FeatureManagementOptions::invalidReason() const {
  return firstUnmet({
      {isPositive(max_sigma_px), "max_sigma_px must be positive"},
      {least_lot >= 1, "least_lot must be at least 1"},
      {trial_frames >= 0, "trial_frames must not be negative"},
      {believed_without_trial >= 0, "believed_without_trial must not be negative"},
      {wary_after_refusals >= 1, "wary_after_refusals must be at least 1"},
      {isNotNegative(wary_s), "wary_s must not be negative"},
      {isNotNegative(wary_trial_s), "wary_trial_s must not be negative"},
      {max_failures >= 0, "max_failures must not be negative"},
      {max_frames_outside >= 0, "max_frames_outside must not be negative"},
      {isShare(blind_share), "blind_share must be 0 to 1"},
      {isPositive(first_depth_m), "first_depth_m must be positive"},
      {isPositive(first_depth_sigma_ratio), "first_depth_sigma_ratio must be positive"},
      {isPositive(marker_depth_sigma_ratio), "marker_depth_sigma_ratio must be positive"},
      {isPositive(depth_sigma_ratio), "depth_sigma_ratio must be positive"},
      {isPositive(search_sigmas), "search_sigmas must be positive"},
      {isPositive(max_search_px), "max_search_px must be positive"},
      {isNotNegative(systematic_s), "systematic_s must not be negative"},
      {remembered_views >= 0, "remembered_views must not be negative"},
      {remembered_points_per_view >= 0, "remembered_points_per_view must not be negative"},
      {recalled_when_worse >= 1.0, "recalled_when_worse must be at least 1"},
      {surfaces_per_frame >= 0, "surfaces_per_frame must not be negative"},
  });
}

std::string VisualFilterOptions::invalidReason() const {
  return firstReason({filter.invalidReason(), patches.invalidReason(), features.invalidReason()});
}

VisualFilter::VisualFilter(const VisualFilterOptions& options)
    : options_(options),
      filter_(options.filter),
      features_(static_cast<std::size_t>(options.filter.max_features)),
      memory_(options.features.remembered_views, options.features.remembered_points_per_view) {
  const auto count = static_cast<std::size_t>(options.filter.max_features);
  candidates_.reserve(count);
  matches_.reserve(count);
  candidate_of_match_.reserve(count);
  ages_.reserve(count);
  accepted_.reserve(count);
  neighbours_.reserve(count);
  shown_.reserve(count);
  // As many parts as there will be, rounded up in both directions.
  found_corners_.reserve(4 * count + 16);
  occupied_.reserve(4 * count + 16);
}

void VisualFilter::reinitialize(const Transform& T_w_c, const Matrix6d& covariance,
                                bool assumes_scale) {
  filter_.start(T_w_c, covariance);
  assumes_scale_ = assumes_scale;
  memory_.clear();
  told_views_ = 0;
  running_ = true;
  marker_depth_m_ = 0.0;
  frames_since_lot_ = 0;
  frame_s_ = 0.0;
  wary_s_ = running_s_ = 0.0;
  was_blind_ = false;
  shown_.clear();
}

void VisualFilter::predict(double dt_s) {
  frame_s_ = dt_s;
  wary_s_ = std::max(0.0, wary_s_ - dt_s);
  running_s_ += dt_s;
  filter_.predict(dt_s);
}

FilteredPose VisualFilter::pose() const {
  const FilterState& state = filter_.state();
  FilteredPose pose;
  pose.T_w_c = state.camera();
  pose.covariance = state.poseCovariance();
  pose.twist << state.camera().R.transpose() * state.velocity(), state.angularVelocity();
  return pose;
}

VisualUpdate VisualFilter::update(const ImageView& image, const CameraModel& camera,
                                  std::span<const KnownMarker> markers,
                                  std::span<const UnplacedMarker> unplaced) {
  VisualUpdate result;
  result.markers = filter_.observeMarkers(markers);
  (void)filter_.observeUnplaced(unplaced);
  if (!markers.empty()) {
    double depth = 0.0;
    for (const KnownMarker& marker : markers) {
      depth += (filter_.state().camera().inverse() * marker.T_w_m.p).z();
    }
    marker_depth_m_ = std::max(kNearest_m, depth / static_cast<double>(markers.size()));
  } else {
    marker_depth_m_ = 0.0;
  }
  shown_.clear();
  if (image.empty()) return result;
  levels_[0] = image;
  levels_[1] = reducers_[0].reduce(levels_[0], 2);
  levels_[2] = reducers_[1].reduce(levels_[1], 2);
  recallPoints(camera, &result);
  lookForFeatures(camera, &result);
  judge(&result);
  dropHopeless(&result);
  if (!result.blind) {
    estimateSurfaces();
    addFeatures(camera, &result);
  }
  filter_.removeEmptyAnchors();
  return result;
}

// --- Search --------------------------------------------------------------------------------------

void VisualFilter::expectFeatures(const CameraModel& camera) {
  candidates_.clear();
  for (std::size_t i = 0; i < features_.size(); ++i) {
    const int feature = static_cast<int>(i);
    if (stateOf(feature).offset < 0) continue;
    const auto expected = filter_.expect(camera, feature);
    if (!expected || !camera.inImage(expected->pixel, kSearchBorder_px)) {
      ++features_[i].outside;
      continue;
    }
    features_[i].outside = 0;
    Candidate& candidate = candidates_.emplace_back();
    candidate.feature = feature;
    candidate.expected = *expected;
    candidate.on_trial = !features_[i].passed;
    expectSkewed(camera, &candidate);
  }
}

double VisualFilter::systematicFrames() const {
  return frame_s_ > 0.0 ? std::max(1.0, 2.0 * options_.features.systematic_s / frame_s_) : 1.0;
}

FeatureMatch VisualFilter::matchOf(const Candidate& candidate, const FoundFeature& found) const {
  const Eigen::Matrix2d covariance = found.covariance + candidate.skew.covariance;
  FeatureMatch match{candidate.feature,  found.pixel - candidate.skew.shift,
                     covariance,         covariance,
                     candidate.on_trial, ageOf(candidate.feature)};
  const Eigen::Matrix2d systematic =
      found.systematic_px * found.systematic_px * Eigen::Matrix2d::Identity();
  match.covariance_once += systematic;
  match.covariance += systematicFrames() * systematic;
  return match;
}

void VisualFilter::findMatches() {
  matches_.clear();
  candidate_of_match_.clear();
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    Candidate& candidate = candidates_[i];
    const auto found = findFeature(
        levels_, features_[static_cast<std::size_t>(candidate.feature)].look,
        stateOf(candidate.feature).rho, candidate.expected,
        {options_.features.search_sigmas, options_.features.max_search_px}, options_.patches);
    if (!found) continue;
    candidate.found = true;
    candidate.stretch = found->stretch;
    matches_.push_back(matchOf(candidate, *found));
    candidate_of_match_.push_back(static_cast<int>(i));
  }
}

void VisualFilter::lookForFeatures(const CameraModel& camera, VisualUpdate* result) {
  expectFeatures(camera);
  findMatches();
  endTrialsOfOldest();
  double squares = 0.0;
  filter_.observeFeatures(camera, matches_, leastConsensus(), &accepted_);
  for (std::size_t k = 0; k < matches_.size(); ++k) {
    Candidate& candidate = candidates_[static_cast<std::size_t>(candidate_of_match_[k])];
    candidate.believed = accepted_[k] != 0;
    if (!candidate.believed || matches_[k].on_trial) continue;
    ++result->believed;
    squares += (matches_[k].pixel + candidate.skew.shift - candidate.expected.pixel).squaredNorm();
  }
  result->expected = static_cast<int>(candidates_.size());
  result->found = static_cast<int>(matches_.size());
  if (result->believed > 0) result->rms_px = std::sqrt(squares / result->believed);
  for (const Candidate& candidate : candidates_) {
    result->on_trial += candidate.on_trial ? 1 : 0;
    shown_.push_back({.pixel = candidate.expected.pixel,
                      .found = candidate.found,
                      .believed = candidate.believed,
                      .feature = candidate.feature,
                      .stretch = candidate.stretch});
  }
  for (std::size_t k = 0; k < matches_.size(); ++k) {
    const auto i = static_cast<std::size_t>(candidate_of_match_[k]);
    Shown& shown = shown_[i];
    shown.match = matches_[k].pixel + candidates_[i].skew.shift;
    shown.sigma_px = std::sqrt(0.5 * matches_[k].covariance_once.trace());
  }
}

// --- Management ----------------------------------------------------------------------------------

void VisualFilter::judge(VisualUpdate* result) {
  const auto believed = std::count_if(candidates_.begin(), candidates_.end(),
                                      [](const Candidate& c) { return c.believed; });
  constexpr int kFew = 4;
  result->blind = result->expected >= kFew &&
                  static_cast<double>(believed) <
                      options_.features.blind_share * static_cast<double>(result->expected);
  was_blind_ = result->blind;
  if (!result->blind) noteRefusals();
  result->wary = wary_s_ > 0.0;
  if (result->blind) return;
  const int trial = trialFrames();
  for (const Candidate& candidate : candidates_) {
    Feature& feature = features_[static_cast<std::size_t>(candidate.feature)];
    ++feature.age;
    feature.passed = feature.passed || feature.age >= trial;
    feature.failures = candidate.believed ? 0 : feature.failures + 1;
  }
}

void VisualFilter::drop(int feature) { filter_.removeFeature(feature); }

void VisualFilter::dropHopeless(VisualUpdate* result) {
  for (std::size_t i = 0; i < features_.size(); ++i) {
    const int feature = static_cast<int>(i);
    const StateFeature& state = stateOf(feature);
    if (state.offset < 0) continue;
    const Feature& f = features_[i];
    // One on trial has no second chance.
    const int failures =
        f.age <= options_.features.trial_frames ? 1 : options_.features.max_failures;
    const double sigma =
        std::sqrt(std::max(0.0, filter_.state().P(state.offset + 2, state.offset + 2)));
    const bool impossible =
        state.rho + 2.0 * sigma < 0.0 || state.rho - 2.0 * sigma > 1.0 / kNearest_m;
    if (f.failures <= failures && f.outside <= options_.features.max_frames_outside &&
        !impossible) {
      continue;
    }
    if (f.failures == 0 && !impossible) remember(feature);
    drop(feature);
    ++result->dropped;
  }
}

bool VisualFilter::isWellKnown(int feature) const {
  const StateFeature& f = stateOf(feature);
  const double variance = filter_.state().P(f.offset + 2, f.offset + 2);
  return f.rho > 0.0 && variance < kWellKnown * kWellKnown * f.rho * f.rho;
}

void VisualFilter::estimateSurfaces() {
  // Neighbours within this part of a radian.
  constexpr double kNear = 0.25;
  const int count = static_cast<int>(features_.size());
  int left = options_.features.surfaces_per_frame;
  for (int tried = 0; tried < count && left > 0; ++tried) {
    const int feature = next_surface_;
    next_surface_ = (next_surface_ + 1) % count;
    const StateFeature& f = stateOf(feature);
    if (f.offset < 0 || !isWellKnown(feature) ||
        features_[static_cast<std::size_t>(feature)].surface_is_told)
      continue;
    --left;
    const Transform& T_w_a = filter_.state().poses()[static_cast<std::size_t>(f.pose)].T_w_s;
    neighbours_.clear();
    for (int other = 0; other < count; ++other) {
      const StateFeature& o = stateOf(other);
      if (other == feature || o.offset < 0 || !isWellKnown(other)) continue;
      const Transform& T_w_b = filter_.state().poses()[static_cast<std::size_t>(o.pose)].T_w_s;
      const Eigen::Vector3d y = directionTo(o, T_w_b, T_w_a);
      if (!(y.z() > 0.1)) continue;
      const Eigen::Vector2d offset = y.head<2>() / y.z() - f.uv;
      if (offset.squaredNorm() > kNear * kNear) continue;
      const double sigma = std::sqrt(filter_.state().P(o.offset + 2, o.offset + 2)) / o.rho;
      neighbours_.push_back({offset, o.rho / (y.z() * f.rho) - 1.0, sigma});
    }
    const auto surface = surfaceGradient(neighbours_);
    features_[static_cast<std::size_t>(feature)].look.surface =
        surface.value_or(Eigen::Vector2d::Zero());
  }
}

// --- New features --------------------------------------------------------------------------------

int VisualFilter::addAtLikelyDepth(const NewFeature& feature, const Eigen::Vector2d& pixel,
                                   int anchor, int first) {
  // The mean of the nearest ones that are known.
  constexpr std::size_t kNearestOnes = 3;
  std::array<double, kNearestOnes> distance2;
  std::array<int, kNearestOnes> nearest{};
  distance2.fill(std::numeric_limits<double>::max());
  for (const Candidate& candidate : candidates_) {
    if (stateOf(candidate.feature).offset < 0 || !candidate.believed ||
        !isWellKnown(candidate.feature)) {
      continue;
    }
    const double d2 = (candidate.expected.pixel - pixel).squaredNorm();
    if (d2 >= distance2.back()) continue;
    distance2.back() = d2;
    nearest.back() = candidate.feature;
    for (std::size_t i = kNearestOnes - 1; i > 0 && distance2[i] < distance2[i - 1]; --i) {
      std::swap(distance2[i], distance2[i - 1]);
      std::swap(nearest[i], nearest[i - 1]);
    }
  }
  if (distance2.back() < std::numeric_limits<double>::max()) {
    return filter_.addFeatureLike(nearest, anchor, feature.uv, feature.uv_covariance,
                                  options_.features.depth_sigma_ratio);
  }
  const bool at_markers = marker_depth_m_ > 0.0;
  const double ratio = at_markers ? options_.features.marker_depth_sigma_ratio
                                  : options_.features.first_depth_sigma_ratio;
  // A guess is one for all of them.
  if (first >= 0 && !assumes_scale_) {
    return filter_.addFeatureLike({&first, 1}, anchor, feature.uv, feature.uv_covariance, ratio);
  }
  const double rho = 1.0 / likelyDepth_m();
  return filter_.addFeature(anchor, feature.uv, rho,
                            featureCovariance(feature.uv_covariance, ratio * rho));
}

auto VisualFilter::cutFeature(const CameraModel& camera, const Eigen::Vector2d& pixel, double rho,
                              double max_sigma_px) const -> std::optional<NewFeature> {
  const int x = static_cast<int>(std::lround(pixel.x()));
  const int y = static_cast<int>(std::lround(pixel.y()));
  const auto uv = camera.undistort({x, y});
  if (!uv) return std::nullopt;
  NewFeature made;
  cutPatch(levels_[0], levels_[1], x, y, &made.feature.look.source);
  PatchTemplate patch;
  if (!warpPatch(made.feature.look.source, {}, 0, &patch)) return std::nullopt;
  const Eigen::Matrix2d C = patch.covariance(options_.patches.image_noise);
  if (!(longestSigma(C) <= max_sigma_px)) return std::nullopt;
  Eigen::Matrix2d D;
  (void)camera.distort(*uv, &D);
  const Eigen::Matrix2d uv_from_pixel = D.inverse();
  // What the patch shows around the feature is what is found again: with the noise it has here.
  const double s = options_.patches.systematic_px;
  const Skew skew = skewOf(camera, pixel.y(), uv->homogeneous(), rho);
  made.uv = *uv - skew.shift;
  made.uv_covariance =
      uv_from_pixel * (C + s * s * Eigen::Matrix2d::Identity()) * uv_from_pixel.transpose() +
      skew.covariance;
  made.feature.look.uv_from_pixel = uv_from_pixel;
  return made;
}

void VisualFilter::findCorners() {
  found_corners_.clear();
  int level = 0;
  while (level < 2 && levels_[static_cast<std::size_t>(level)].width > kCornerImageWidth_px)
    ++level;
  const ImageView& image = levels_[static_cast<std::size_t>(level)];
  const double parts = kPartsPerFeature * static_cast<double>(features_.size());
  const double side =
      std::max(12.0, std::sqrt(static_cast<double>(image.width) * image.height / parts));
  const int columns = std::max(1, static_cast<int>(image.width / side));
  const int rows = std::max(1, static_cast<int>(image.height / side));
  occupied_.assign(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows), char{0});
  for (const Candidate& candidate : candidates_) {
    if (stateOf(candidate.feature).offset < 0) continue;
    const Eigen::Vector2d at = onLevel(candidate.expected.pixel, level);
    const int column = std::clamp(static_cast<int>(at.x() * columns / image.width), 0, columns - 1);
    const int row = std::clamp(static_cast<int>(at.y() * rows / image.height), 0, rows - 1);
    occupied_[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
              static_cast<std::size_t>(column)] = 1;
  }
  const int margin = (kNewBorder_px >> level) + 1;
  // Not at a part's edge, where the neighbour's feature may be.
  const int inset = static_cast<int>(side / 8.0);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      if (occupied_[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
                    static_cast<std::size_t>(column)]) {
        continue;
      }
      FoundCorner corner = corners_.best(image, image.width * column / columns + inset,
                                         image.height * row / rows + inset,
                                         image.width * (column + 1) / columns - inset,
                                         image.height * (row + 1) / rows - inset, margin);
      if (!(corner.score > 0.0F)) continue;
      corner.x <<= level;
      corner.y <<= level;
      found_corners_.push_back(corner);
    }
  }
  std::sort(found_corners_.begin(), found_corners_.end(),
            [](const FoundCorner& a, const FoundCorner& b) {
              if (a.score != b.score) return a.score > b.score;
              return a.y != b.y ? a.y < b.y : a.x < b.x;
            });
}

// The anchor with the fewest features goes, if these are few.
bool VisualFilter::makeRoomForAnchor() {
  if (filter_.anchorCount() < options_.filter.max_anchors) return true;
  int fewest = -1;
  int left = options_.features.least_lot;
  const auto& poses = filter_.state().poses();
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (poses[i].offset < 0 || poses[i].kind != PoseKind::kAnchor) continue;
    if (poses[i].features >= left) continue;
    left = poses[i].features;
    fewest = static_cast<int>(i);
  }
  if (fewest < 0) return false;
  for (std::size_t i = 0; i < features_.size(); ++i) {
    const int feature = static_cast<int>(i);
    if (stateOf(feature).offset >= 0 && stateOf(feature).pose == fewest) drop(feature);
  }
  filter_.removeEmptyAnchors();
  return true;
}

void VisualFilter::addFeatures(const CameraModel& camera, VisualUpdate* result) {
  ++frames_since_lot_;
  const int room = static_cast<int>(features_.size()) - filter_.state().featureCount();
  // Of those that are there but not in view, others are in the way: they go after a while.
  const int lot = std::min(options_.features.least_lot, static_cast<int>(features_.size()));
  constexpr int kFramesBetweenLots = 3;
  if (room < lot || frames_since_lot_ < kFramesBetweenLots) return;
  frames_since_lot_ = 0;
  findCorners();
  if (static_cast<int>(found_corners_.size()) < lot && filter_.state().featureCount() > 0) return;
  if (found_corners_.empty() || !makeRoomForAnchor()) return;
  filter_.removeEmptyAnchors();
  const int anchor = filter_.addAnchor();
  if (anchor < 0) return;
  int first = -1;
  for (const FoundCorner& corner : found_corners_) {
    if (filter_.state().featureCount() >= static_cast<int>(features_.size())) break;
    const Eigen::Vector2d pixel(corner.x, corner.y);
    const auto made =
        cutFeature(camera, pixel, 1.0 / likelyDepth_m(), options_.features.max_sigma_px);
    if (!made) continue;
    const int place = addAtLikelyDepth(*made, pixel, anchor, first);
    if (place < 0) continue;
    features_[static_cast<std::size_t>(place)] = made->feature;
    if (first < 0) first = place;
    ++result->added;
  }
}

int VisualFilter::addKnownPoints(const ImageView& image, const CameraModel& camera,
                                 std::span<const KnownPoint> points) {
  levels_[0] = image;
  levels_[1] = reducers_[0].reduce(levels_[0], 2);
  levels_[2] = reducers_[1].reduce(levels_[1], 2);
  makeRoomFor(static_cast<int>(points.size()));
  if (!makeRoomForAnchor()) return 0;
  const int anchor = filter_.addAnchor();
  if (anchor < 0) return 0;
  constexpr double kAnyTexture = 1.0;
  int added = 0;
  for (const KnownPoint& point : points) {
    if (!camera.inImage(point.pixel, kNewBorder_px)) continue;
    const auto made = cutFeature(camera, point.pixel, point.rho, kAnyTexture);
    if (!made) continue;
    const int place = filter_.addFeature(anchor, made->uv, point.rho,
                                         featureCovariance(made->uv_covariance, point.rho_sigma));
    if (place < 0) break;
    features_[static_cast<std::size_t>(place)] = made->feature;
    ++added;
  }
  filter_.removeEmptyAnchors();
  return added;
}

}  // namespace waymark::slam
