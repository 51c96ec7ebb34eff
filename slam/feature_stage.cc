#include "slam/feature_stage.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include "slam/covariance/marginals.h"
#include "slam/geometry/turned_covariance.h"

namespace waymark::slam {

namespace {

// With several the pose is relative to all of them, and they have their doubts about each other.
bool hasOnePlaced(const Map& map) {
  int placed = 0;
  for (const auto& [id, marker] : map.markers()) {
    placed += marker.T_w_m ? 1 : 0;
    if (placed > 1) return false;
  }
  return placed == 1;
}

}  // namespace

bool FeatureStage::concerns(const FrameInput& frame) const {
  return options_.enabled && frame.image;
}

void FeatureStage::moveWorld(const Transform& T_new_old) {
  integrator_.moveWorld(T_new_old);
  anchor_.T_w_m = T_new_old * anchor_.T_w_m;
}

bool FeatureStage::beginsAtAny(std::span<const KnownMarker> markers) const {
  return std::ranges::any_of(markers, [&](const KnownMarker& marker) {
    return isWithin(options_.integrator.start, marker.detection->pixels, camera_.width(),
                    camera_.height());
  });
}

bool FeatureStage::beginsAt(const LateResult& seen, const PicturePrint& print) const {
  const Transform T_c_m = seen.T_m_c.inverse();
  const double x = 0.5 * print.width_m;
  const double y = 0.5 * print.height_m;
  std::array<Eigen::Vector2d, 4> corners_px;
  const std::array<Eigen::Vector3d, 4> corners = {
      {{-x, y, 0.0}, {x, y, 0.0}, {x, -y, 0.0}, {-x, -y, 0.0}}};
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const auto pixel = camera_.project(T_c_m * corners[k]);
    if (!pixel) return options_.integrator.start.border == 0.0;  // beyond any image
    corners_px[k] = *pixel;
  }
  return isWithin(options_.integrator.start, corners_px, camera_.width(), camera_.height());
}

// The pose is relative to it: a first view's error, which the next keyframes take back, say.
void FeatureStage::followAnchor(const Map& map) {
  const MapMarker* const marker = map.findPosed(anchor_.id);
  if (marker == nullptr) return;
  const Transform& T_w_m = *marker->T_w_m;
  if (T_w_m.p == anchor_.T_w_m.p && T_w_m.R == anchor_.T_w_m.R) return;
  integrator_.moveWorld(T_w_m * anchor_.T_w_m.inverse());
  anchor_.T_w_m = T_w_m;
}

bool FeatureStage::follow(const FrameInput& frame, const TrackedFrame& tracked,
                          const PoseEstimate& pose, const Map& map, StageObserver* observer) {
  followed_ = concerns(frame);
  lost_ = false;  // where the features know better, the frame before had a pose
  if (!followed_) return true;
  const StageScope scope(observer, Stage::kFeatures);
  const bool is_only = hasOnePlaced(map);
  if (is_only) followAnchor(map);
  fitting_.clear();
  anchor_before_ = anchor_.id;
  for (std::size_t i = 0; i < tracked.eligible.size(); ++i) {
    if (tracked.solution.inlier[i]) fitting_.push_back(tracked.eligible[i]);
  }
  const auto distance_m = [&](const KnownMarker& marker) {
    return (marker.T_w_m.p - pose.T_w_c.p).norm();
  };
  const auto nearest = std::ranges::min_element(fitting_, {}, distance_m);
  // What the pose is relative to: what is not known of its place is the world's share, and not to
  // be counted twice.
  if (fitting_.size() == 1 && is_only) nearest->covariance.setZero();
  const bool is_sure = isCertain(tracked) || tracked.single->covered;
  const Beginning where = beginsAtAny(fitting_) ? Beginning::kAllowed : Beginning::kOutside;
  const bool agrees = integrator_.follow(frame.time.monotonic_ns, *frame.image, pose,
                                         is_sure ? where : Beginning::kAmbiguous, fitting_);
  if (agrees && nearest != fitting_.end()) anchor_ = {nearest->detection->id, nearest->T_w_m};
  return agrees;
}

std::optional<FeatureStage::Arrival> FeatureStage::arrival() const {
  if (!followed_ || !integrator_.arrival() || anchor_before_ < 0) return std::nullopt;
  return Arrival{*integrator_.arrival(), anchor_before_};
}

std::optional<PoseEstimate> FeatureStage::inWorld(std::optional<PoseEstimate> pose) const {
  if (pose) pose->covariance += covariance_.sharedAt(pose->T_w_c.p);
  return pose;
}

std::optional<PoseEstimate> FeatureStage::fused() const {
  return followed_ ? inWorld(integrator_.fused()) : std::nullopt;
}

void FeatureStage::findUnplaced(std::span<const MarkerDetection> detections, const Map& map) {
  const auto most = static_cast<std::size_t>(options_.filter.filter.max_markers);
  unplaced_.clear();
  for (const MarkerDetection& detection : detections) {
    if (unplaced_.size() == most) return;
    const MapMarker* const known = map.find(detection.id);
    const bool is_unplaced = known == nullptr || known->state == MarkerState::kUnresolved ||
                             known->state == MarkerState::kElsewhere;
    if (!is_unplaced) continue;
    unplaced_.push_back(
        unplacedMarker(detection, markers_.sizeOf(detection.id), camera_.focalLength(), resolver_));
  }
}

std::optional<PoseEstimate> FeatureStage::bridge(const FrameInput& frame,
                                                 std::span<const MarkerDetection> detections,
                                                 const Map& map, StageObserver* observer) {
  refused_ = false;
  if (!concerns(frame)) return std::nullopt;
  const StageScope scope(observer, Stage::kFeatures);
  if (hasOnePlaced(map)) followAnchor(map);
  findUnplaced(detections, map);
  const auto pose = integrator_.bridge(frame.time.monotonic_ns, *frame.image, unplaced_);
  refused_ = integrator_.tooUncertain();
  // What is adrift had no place to lose.
  lost_ = !pose && (lost_ || (refused_ && !integrator_.adrift()));
  return inWorld(pose);
}

// Markers in view that give no pose say more than that an earlier one is gone.
void FeatureStage::tellIfLost(FrameResult* result) const {
  if (lost_) result->state = TrackingState::kLost;
  const bool nothing_in_view = result->reason == NoPoseReason::kNoMarker;
  if (refused_ || (lost_ && nothing_in_view)) result->reason = NoPoseReason::kCarriedTooUncertain;
}

void FeatureStage::await(const FrameInput& frame, bool has_pose, StageObserver* observer) {
  if (!concerns(frame)) return;
  const StageScope scope(observer, Stage::kFeatures);
  integrator_.await(frame.time.sequence, frame.time.monotonic_ns, *frame.image, has_pose);
}

// What a picture's own views leave open of its place is a new error where the pose comes from
// somewhere else, and part of what it is relative to where it came from there already.
void FeatureStage::late(const LateResult& seen, const MapMarker& picture, const PicturePrint& print,
                        StageObserver* observer) {
  if (!options_.enabled) return;
  const StageScope scope(observer, Stage::kFeatures);
  const Transform& T_w_p = *picture.T_w_m;
  const bool elsewhere = anchor_.id != picture.id && !integrator_.adrift();
  const auto fixOf = [&](const Transform& T_m_c, const Matrix6d& of_view) {
    LateFix fix{seen.sequence, T_w_p * T_m_c, turnedCovariance(T_w_p.R, of_view)};
    const Matrix6d T = rigidTransport(fix.T_w_c.p - T_w_p.p);
    if (elsewhere) fix.covariance += T * picture.covariance * T.transpose();
    return fix;
  };
  LatePose pose{.fix = fixOf(seen.T_m_c, seen.covariance),
                .other = {},
                .decided = seen.decided,
                .begins = beginsAt(seen, print)};
  if (seen.other) pose.other = fixOf(seen.other->T_m_c, seen.other->covariance);
  points_w_.clear();
  for (const Eigen::Vector2d& p : print.points_m) {
    points_w_.push_back(T_w_p * Eigen::Vector3d(p.x(), p.y(), 0.0));
  }
  switch (integrator_.late(pose, points_w_)) {
    case LateOutcome::kStarted:
      covariance_.doubtAs(picture);
      anchor_ = {picture.id, T_w_p};
      ++counters_->picture_poses;
      break;
    case LateOutcome::kUsed:
      if (covariance_.doubtIfLess(picture, pose.fix.T_w_c.p)) anchor_ = {picture.id, T_w_p};
      ++counters_->picture_poses;
      break;
    case LateOutcome::kRefused:
      ++counters_->refused_pictures;
      break;
    case LateOutcome::kNoted:
      covariance_.doubtAs(picture);
      anchor_ = {picture.id, T_w_p};
      break;
    case LateOutcome::kOutside:
      ++counters_->starts_outside;
      break;
    case LateOutcome::kOpen:
    case LateOutcome::kKnown:
    case LateOutcome::kUnknown:
      break;
  }
}

}  // namespace waymark::slam
