#include "slam/natural/pose_integrator.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include <Eigen/Cholesky>

#include "base/elapsed.h"
#include "slam/covariance/marginals.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/late_result.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Of the pose that a picture gives: its other one has been refuted.
constexpr double kUnambiguous = LateResult::kUnambiguous;

// Three standard deviations of the error's length.
double threeSigma(const Eigen::Matrix3d& covariance) {
  return 3.0 * std::sqrt(std::max(0.0, covariance.trace()));
}

// Of the position.
double variance(const Matrix6d& covariance) { return covariance.topLeftCorner<3, 3>().trace(); }

bool isFinite(const FilteredPose& pose) {
  return pose.covariance.allFinite() && pose.T_w_c.p.allFinite();
}

}  // namespace

std::string PoseIntegratorOptions::invalidReason() const {
  return firstReason(
      {firstUnmet({{max_markers >= 1, "max_markers must be at least 1"},
                   {isNotNegative(idle_after_s), "idle_after_s must not be negative"},
                   {min_features >= 3, "min_features must be at least 3"},
                   {isNotNegative(max_prediction_s), "max_prediction_s must not be negative"},
                   {isPositive(max_pause_s), "max_pause_s must be positive"},
                   {isPositive(max_error_m), "max_error_m must be positive"},
                   {isPositive(max_error_rad), "max_error_rad must be positive"},
                   {isPositive(max_innovation_chi2), "max_innovation_chi2 must be positive"},
                   {isPositive(max_blind_s), "max_blind_s must be positive"},
                   {witnesses >= 1, "witnesses must be at least 1"},
                   {isPositive(start_sigma_m), "start_sigma_m must be positive"},
                   {isPositive(start_sigma_rad), "start_sigma_rad must be positive"},
                   {isPositive(adrift_scale_sigma), "adrift_scale_sigma must be positive"},
                   {isPositive(max_start_error), "max_start_error must be positive"}}),
       unscaled_way.invalidReason(), start.invalidReason()});
}

std::string NaturalOptions::invalidReason() const {
  std::map<int, std::string> names;
  for (const PicturePrint& print : prints) {
    const std::string of = "the natural marker \"" + print.name + "\"";
    if (print.name.empty()) return "a natural marker has no name";
    if (!isPositive(print.width_m) || !isPositive(print.height_m)) {
      return of + " has no width or no height";
    }
    if (!isPositive(print.sigma_m) || !isPositive(print.sigma_rad)) {
      return of + ": its sigmas must be positive";
    }
    const auto [other, is_new] = names.emplace(pictureId(print.name), print.name);
    if (!is_new && other->second == print.name) return of + " is given twice";
    if (!is_new) {
      return of + " and \"" + other->second + "\" have the same number: rename one of them";
    }
  }
  return firstReason({filter.invalidReason(), integrator.invalidReason()});
}

PoseIntegrator::PoseIntegrator(const NaturalOptions& options, const CameraModel& camera,
                               Counters* counters)
    : options_(options),
      camera_(camera),
      counters_(counters),
      unscaled_way_(options_.integrator.unscaled_way) {
  if (options.enabled) filter_.emplace(options.filter);
}

bool PoseIntegrator::follow(std::int64_t time_ns, const ImageView& image, const PoseEstimate& pose,
                            Beginning beginning, std::span<const KnownMarker> markers) {
  const bool features_knew = bridging_ || fused_;
  fused_.reset();
  arrival_.reset();
  if (!filter_) return true;
  if (adrift_) giveUp();  // the markers know better
  late_refusals_ = contradicted_ = 0;
  contradiction_.setZero();
  known_points_w_.clear();
  advance(time_ns);
  if (running() && contradicts(pose)) {
    if (++contradictions_ < options_.integrator.witnesses) return !features_knew;
    filter_->reset();
    ++counters_->filter_restarts;
  }
  contradictions_ = 0;
  if (isIdle(time_ns, markers.size())) filter_->reset();
  const bool goes_on = running();
  const bool are_few = static_cast<int>(markers.size()) <= options_.integrator.max_markers;
  if (!goes_on) {
    bridging_ = false;
    if (!are_few || beginning == Beginning::kAmbiguous) return true;
    if (beginning == Beginning::kOutside) {
      ++counters_->starts_outside;
      return true;
    }
    start(time_ns, pose);
  }
  if (goes_on && bridging_) arrival_ = filteredPose();
  unscaled_way_.forget();
  carried_on_ = goes_on && (carried_on_ || bridging_);
  const VisualUpdate update = filter_->update(image, camera_, markers);
  counters_->wary_frames += update.wary ? 1 : 0;
  if (goes_on && are_few) fused_ = fusedPose(pose, update);
  last_seen_ns_ = time_ns;
  bridging_ = false;
  ambiguity_ratio_ = pose.ambiguity_ratio;
  giveUpIfAtOdds(update);
  return true;
}

std::optional<FilteredPose> PoseIntegrator::carriedOn() const {
  if (!carried_on_ || !running()) return std::nullopt;
  const FilteredPose pose = filter_->pose();
  return isFinite(pose) ? std::optional(pose) : std::nullopt;
}

void PoseIntegrator::giveUpIfAtOdds(const VisualUpdate& update) {
  const bool refuses_markers = update.markers.used == 0 && update.markers.refused > 0;
  // Patches are found, but hardly one is where the markers have it: that is not the image.
  const double share = options_.filter.features.blind_share;
  const bool refuses_features =
      update.blind && update.markers.used > 0 && update.found > share * update.expected;
  const bool at_odds = refuses_markers || refuses_features;
  at_odds_ = at_odds ? at_odds_ + 1 : 0;
  if (at_odds_ < options_.integrator.witnesses) return;
  at_odds_ = 0;
  filter_->reset();  // the next frame's markers start it anew
  ++counters_->filter_restarts;
}

std::optional<PoseEstimate> PoseIntegrator::fusedPose(const PoseEstimate& of_markers,
                                                      const VisualUpdate& update) const {
  const FilteredPose pose = filter_->pose();
  // A filter that refuses a marker is not where that marker is.
  const bool by_markers = update.markers.used > 0 && update.markers.refused == 0;
  if (!by_markers || update.believed < options_.integrator.min_features || !isFinite(pose) ||
      !(variance(pose.covariance) < variance(of_markers.view_covariance))) {
    return std::nullopt;
  }
  PoseEstimate fused = of_markers;
  fused.T_w_c = pose.T_w_c;
  fused.covariance = fused.view_covariance = pose.covariance;
  fused.twist = pose.twist;
  fused.features_used = update.believed;
  return fused;
}

std::optional<VisualUpdate> PoseIntegrator::look(std::int64_t time_ns, const ImageView& image,
                                                 std::span<const UnplacedMarker> unplaced) {
  // Adrift, the scale is what two pictures say of it.
  if (adrift_) unplaced = {};
  const VisualUpdate update = filter_->update(image, camera_, {}, unplaced);
  counters_->wary_frames += update.wary ? 1 : 0;
  if (update.believed >= options_.integrator.min_features) last_seen_ns_ = time_ns;
  const double blind_s = secondsBetween(last_seen_ns_, time_ns);
  if (blind_s <= options_.integrator.max_blind_s && isFinite(filter_->pose())) return update;
  giveUp();
  return std::nullopt;
}

std::optional<PoseEstimate> PoseIntegrator::bridge(std::int64_t time_ns, const ImageView& image,
                                                   std::span<const UnplacedMarker> unplaced) {
  bridging_ = too_uncertain_ = false;
  fused_.reset();
  advance(time_ns);
  if (!running()) return std::nullopt;
  const auto update = look(time_ns, image, unplaced);
  if (!update) return std::nullopt;
  if (!known_points_w_.empty()) addKnownPoints(image);
  FeatureFilter& filter = filter_->filter();
  if (!adrift_) unscaled_way_.goOn(filter.state().camera().p, filter.scaleSigma());
  const auto placed = adrift_ ? placedByFirstFix() : filteredPose();
  if (!placed) return std::nullopt;
  const bool seen = last_seen_ns_ == time_ns;
  FilteredPose pose = *placed;
  pose.covariance += contradiction_;
  const double blind_s = secondsBetween(last_seen_ns_, time_ns);
  if (blind_s > options_.integrator.max_prediction_s) return std::nullopt;
  too_uncertain_ = isTooUncertain(pose);
  if (too_uncertain_) {
    ++counters_->uncertain_frames;
    return std::nullopt;
  }
  bridging_ = seen;
  ++(seen ? counters_->bridged_frames : counters_->predicted_frames);
  PoseEstimate estimate;
  estimate.T_w_c = pose.T_w_c;
  estimate.covariance = estimate.view_covariance = pose.covariance;
  estimate.twist = pose.twist;
  estimate.source = seen ? PoseSource::kNaturalFeatures : PoseSource::kPrediction;
  estimate.features_used = seen ? update->believed : 0;
  estimate.reprojection_rms_px = seen ? update->rms_px : 0.0;
  estimate.ambiguity_ratio = ambiguity_ratio_;
  return estimate;
}

void PoseIntegrator::await(std::uint64_t frame, std::int64_t time_ns, const ImageView& image,
                           bool has_pose) {
  if (!filter_) return;
  if (!running()) {
    if (has_pose) return;
    start(time_ns, {}, true);
    (void)filter_->update(image, camera_, {});
    last_seen_ns_ = time_ns;
    adrift_ = true;
    guessed_scale_.reset();
  }
  // Who looks has answered; what contradicts the filter is still to be compared.
  if (!adrift_ && late_refusals_ == 0) filter_->filter().forgetPast();
  filter_->filter().markPast(frame);
}

LateOutcome PoseIntegrator::use(const Fix& fix) {
  FeatureFilter& filter = filter_->filter();
  // Pictures' errors are much the same from image to image: averaging them would make too much of
  // them.
  if (variance(filteredPose().covariance) < variance(fix.covariance)) return LateOutcome::kKnown;
  (void)filter.observePastPose(fix.frame, fix.T_w_c, fix.covariance);
  unscaled_way_.forget();
  return LateOutcome::kUsed;
}

LateOutcome PoseIntegrator::weigh(const LatePose& pose) {
  const auto agrees = [&](const Fix& fix) {
    return filter_->filter().comparePastPose(fix.frame, fix.T_w_c, fix.covariance) ==
           PoseOutcome::kUsed;
  };
  const bool first = agrees(pose.fix);
  const bool other = pose.other && agrees(*pose.other);
  if (!first && !other) return LateOutcome::kRefused;
  late_refusals_ = contradicted_ = 0;
  contradiction_.setZero();
  if (first && (pose.decided || !other)) return use(pose.fix);
  return other && !first && !pose.decided ? use(*pose.other) : LateOutcome::kOpen;
}

bool PoseIntegrator::turnedAlike(const Fix& a, const Eigen::Matrix3d& a_R_w_c, const Fix& b,
                                 const Eigen::Matrix3d& b_R_w_c) const {
  constexpr double kChi2 = 16.3;  // of 3 dimensions: 99.9 %
  // In the world of the fixes, each of which has an error of its own.
  const Eigen::Matrix3d expected = a.T_w_c.R * a_R_w_c.transpose() * b_R_w_c;
  const Eigen::Vector3d turn = logSo3(b.T_w_c.R * expected.transpose());
  const Eigen::Matrix3d S =
      a.covariance.bottomRightCorner<3, 3>() + b.covariance.bottomRightCorner<3, 3>();
  return turn.dot(S.ldlt().solve(turn)) <= kChi2;
}

bool PoseIntegrator::isOutvoted(const Fix& fix) {
  const FeatureFilter& filter = filter_->filter();
  const auto frame = filter.pastPose(fix.frame);
  if (!frame) return false;
  const auto first = first_refused_ ? filter.pastPose(first_refused_->frame) : std::nullopt;
  if (!first || !turnedAlike(*first_refused_, first->R, fix, frame->R)) late_refusals_ = 0;
  if (late_refusals_ == 0) first_refused_ = fix;
  ++late_refusals_;
  ++contradicted_;
  // A filter that has gone astray does not know how the camera has turned either: many are enough
  // whatever it says of them.
  if (late_refusals_ < options_.integrator.witnesses &&
      contradicted_ < 2 * options_.integrator.witnesses) {
    return false;
  }
  late_refusals_ = contradicted_ = 0;
  first_fix_ = std::exchange(first_refused_, std::nullopt);
  return true;
}

LateOutcome PoseIntegrator::late(const LatePose& pose, std::span<const Eigen::Vector3d> points_w) {
  if (!running() || points_w.empty()) return LateOutcome::kUnknown;
  const Fix& fix = pose.fix;
  const auto then = filter_->filter().pastPose(fix.frame);
  if (!then) return LateOutcome::kUnknown;
  if (!adrift_) {
    const LateOutcome outcome = weigh(pose);
    if (outcome == LateOutcome::kRefused && pose.decided) {
      const Vector6d apart = then->localCoordinates(fix.T_w_c);
      contradiction_ = apart * apart.transpose();
    }
    const bool contradicts = outcome == LateOutcome::kRefused && pose.decided && pose.begins;
    if (!contradicts || !isOutvoted(fix)) return outcome;
    adrift_ = true;
    contradiction_.setZero();  // the pictures are right
    guessed_scale_ = 1.0;      // it had one
  }
  if (!pose.decided) return LateOutcome::kOpen;
  if (!pose.begins) return LateOutcome::kOutside;
  const Eigen::Map<const Eigen::Matrix3Xd> points(points_w.front().data(), 3,
                                                  static_cast<Eigen::Index>(points_w.size()));
  const double distance_m = (points.rowwise().mean() - fix.T_w_c.p).norm();
  // What is in view is about as far away as the picture.
  if (!guessed_scale_) guessed_scale_ = distance_m / options_.filter.features.first_depth_m;
  const auto now = carriedFrom(fix);
  if (!now || now->doubt_m > options_.integrator.max_start_error * distance_m) {
    note(fix);
    return LateOutcome::kNoted;
  }
  begin(fix, now->scale, points_w);
  return LateOutcome::kStarted;
}

// The first one stays, for the longest way, as long as its camera is remembered and no later one
// contradicts it.
void PoseIntegrator::note(const Fix& fix) {
  ambiguity_ratio_ = kUnambiguous;
  FeatureFilter& filter = filter_->filter();
  // Of no known scale, by definition: how little is known of that is scaleOf()'s.
  (void)filter.rescaleFromPast(fix.frame, 1.0, 0.0);
  const auto first = first_fix_ ? filter.pastPose(first_fix_->frame) : std::nullopt;
  const auto now = filter.pastPose(fix.frame);
  if (!first || !now || !turnedAlike(*first_fix_, first->R, fix, now->R)) first_fix_ = fix;
}

void PoseIntegrator::begin(const Fix& fix, const Scale& scale,
                           std::span<const Eigen::Vector3d> points_w) {
  FeatureFilter& filter = filter_->filter();
  filter_->forgetPoints();
  (void)filter.rescaleFromPast(fix.frame, scale.metres, scale.sigma);
  (void)filter.restartFromPast(fix.frame, fix.T_w_c, fix.covariance);
  known_points_w_.assign(points_w.begin(), points_w.end());
  first_fix_.reset();
  contradiction_.setZero();
  unscaled_way_.forget();
  adrift_ = false;
  ambiguity_ratio_ = kUnambiguous;
}

void PoseIntegrator::addKnownPoints(const ImageView& image) {
  const FilteredPose pose = filter_->pose();
  const Transform T_c_w = pose.T_w_c.inverse();
  std::vector<VisualFilter::KnownPoint> points;
  for (const Eigen::Vector3d& p_w : known_points_w_) {
    const Eigen::Vector3d p_c = T_c_w * p_w;
    if (p_c.z() <= 0.0) continue;
    const auto pixel = camera_.project(p_c);
    if (!pixel) continue;
    // Along the optical axis the point is as uncertain as the camera there.
    const Matrix6d T = rigidTransport(p_w - pose.T_w_c.p);
    const Eigen::Vector3d axis_w = pose.T_w_c.R.col(2);
    const Matrix6d at_point = T * pose.covariance * T.transpose();
    const double depth_variance = axis_w.dot(at_point.topLeftCorner<3, 3>() * axis_w);
    const double rho = 1.0 / p_c.z();
    points.push_back({*pixel, rho, rho * rho * std::sqrt(std::max(0.0, depth_variance))});
  }
  known_points_w_.clear();
  (void)filter_->addKnownPoints(image, camera_, points);
}

std::optional<FilteredPose> PoseIntegrator::placedByFirstFix() const {
  const auto carried = first_fix_ ? carriedFrom(*first_fix_) : std::nullopt;
  return carried ? std::optional(carried->pose) : std::nullopt;
}

PoseIntegrator::Scale PoseIntegrator::scaleOf(const Fix& fix) const {
  Scale scale{guessed_scale_.value_or(1.0), options_.integrator.adrift_scale_sigma};
  if (!first_fix_) return scale;
  const FeatureFilter& filter = filter_->filter();
  const auto first = filter.pastPose(first_fix_->frame);
  const auto second = filter.pastPose(fix.frame);
  if (!first || !second) return scale;
  // Of one of a plane's two poses and the other: no way that was gone.
  if (!turnedAlike(*first_fix_, first->R, fix, second->R)) return scale;
  const double own = (second->p - first->p).norm();
  const Eigen::Vector3d way = fix.T_w_c.p - first_fix_->T_w_c.p;
  const double sigma_m = std::sqrt(variance(fix.covariance) + variance(first_fix_->covariance));
  // Less says nothing.
  if (!(way.norm() > sigma_m) || !(own > 0.0)) return scale;
  return {way.norm() / own, sigma_m / way.norm()};
}

std::optional<PoseIntegrator::Carried> PoseIntegrator::carriedFrom(const Fix& fix) const {
  const auto motion = filter_->filter().motionSince(fix.frame);
  if (!motion || !motion->T_p_c.p.allFinite() || !motion->covariance.allFinite()) {
    return std::nullopt;
  }
  const Scale scale = scaleOf(fix);
  Transform T_p_c = motion->T_p_c;
  T_p_c.p *= scale.metres;
  Matrix6d way = motion->covariance;
  way.topRows<3>() *= scale.metres;
  way.leftCols<3>() *= scale.metres;
  way.topLeftCorner<3, 3>() += scale.sigma * scale.sigma * T_p_c.p * T_p_c.p.transpose();

  Carried carried{
      .pose = {.T_w_c = fix.T_w_c * T_p_c}, .scale = scale, .doubt_m = std::sqrt(variance(way))};
  const Matrix6d T = rigidTransport(carried.pose.T_w_c.p - fix.T_w_c.p);
  carried.pose.covariance = T * fix.covariance * T.transpose() + turnedCovariance(fix.T_w_c.R, way);
  return carried;
}

void PoseIntegrator::moveWorld(const Transform& T_new_old) {
  if (running() && !adrift_) filter_->moveWorld(T_new_old);
  for (Eigen::Vector3d& p_w : known_points_w_) p_w = T_new_old * p_w;
  contradiction_ = turnedCovariance(T_new_old.R, contradiction_);
  unscaled_way_.moveWorld(T_new_old);
  for (std::optional<Fix>* fix : {&first_fix_, &first_refused_}) {
    if (!*fix) continue;
    (*fix)->T_w_c = T_new_old * (*fix)->T_w_c;
    (*fix)->covariance = turnedCovariance(T_new_old.R, (*fix)->covariance);
  }
}

void PoseIntegrator::advance(std::int64_t time_ns) {
  if (!running() || time_ns == time_ns_) return;
  const double dt_s = secondsBetween(time_ns_, time_ns);
  time_ns_ = time_ns;
  if (dt_s > 0.0 && dt_s <= options_.integrator.max_pause_s) {
    filter_->predict(dt_s);
  } else {
    giveUp();
  }
}

void PoseIntegrator::giveUp() {
  filter_->reset();
  adrift_ = false;
  first_fix_.reset();
  known_points_w_.clear();
  contradiction_.setZero();
  unscaled_way_.forget();
}

void PoseIntegrator::start(std::int64_t time_ns, const PoseEstimate& pose, bool assumes_scale) {
  const PoseIntegratorOptions& options = options_.integrator;
  Matrix6d covariance = pose.view_covariance;
  covariance.diagonal().head<3>().array() += options.start_sigma_m * options.start_sigma_m;
  covariance.diagonal().tail<3>().array() += options.start_sigma_rad * options.start_sigma_rad;
  filter_->reinitialize(pose.T_w_c, covariance, assumes_scale);
  time_ns_ = time_ns;
}

bool PoseIntegrator::isIdle(std::int64_t time_ns, std::size_t markers) {
  if (static_cast<int>(markers) <= options_.integrator.max_markers) few_markers_ns_ = time_ns;
  return running() && secondsBetween(few_markers_ns_, time_ns) > options_.integrator.idle_after_s;
}

bool PoseIntegrator::contradicts(const PoseEstimate& pose) const {
  const FilteredPose filtered = filter_->pose();
  const Vector6d innovation = filtered.T_w_c.localCoordinates(pose.T_w_c);
  const Matrix6d S = filtered.covariance + pose.view_covariance;
  const double chi2 = innovation.dot(S.ldlt().solve(innovation));
  return !(chi2 <= options_.integrator.max_innovation_chi2);
}

FilteredPose PoseIntegrator::filteredPose() const {
  FilteredPose pose = filter_->pose();
  pose.covariance.topLeftCorner<3, 3>() += unscaled_way_.covariance();
  return pose;
}

bool PoseIntegrator::isTooUncertain(const FilteredPose& pose) const {
  return threeSigma(pose.covariance.topLeftCorner<3, 3>()) > options_.integrator.max_error_m ||
         threeSigma(pose.covariance.bottomRightCorner<3, 3>()) > options_.integrator.max_error_rad;
}

}  // namespace waymark::slam
