#include "slam/camera/lens_watch.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "slam/camera/undistort_map.h"
#include "slam/camera_pose/pose_optimizer.h"

namespace waymark::slam {

void LensWatch::forget() {
  seen_ = Map();
  estimate_.reset();
  estimated_from_ = 0;
  is_undecided_ = false;
  times_seen_ = 0;
}

// How the camera moves in a known map is as wrong as the lens, and with it what a rolling shutter
// has moved the corners by, which speaks for that lens: each time half of it is left.
void LensWatch::seeAgain() {
  constexpr int kTimes = 4;
  seen_ = Map();
  if (times_seen_++ < kTimes) {
    estimated_from_ = std::min(estimated_from_, options_.watch.max_frames / 2);
  }
}

void LensWatch::look(const FrameTime& time, const Transform& T_w_c, const Twist& twist,
                     std::span<const KnownMarker> known) {
  if (!options_.learn || known.size() < 2) return;
  noteFit(time, T_w_c, known);
  if (!asks() || !isAnotherView(time, T_w_c, known)) return;
  Keyframe frame;
  frame.sequence = time.sequence;
  frame.monotonic_ns = time.monotonic_ns;
  frame.T_w_c = T_w_c;
  frame.twist = twist;
  for (const KnownMarker& marker : known) {
    frame.detections.push_back(*marker.detection);
    seen_.addMarker(marker.detection->id, marker.size_m);
    seen_.place(marker.detection->id, marker.T_w_m);
  }
  (void)seen_.addKeyframe(std::move(frame));
  if (!estimate_ && static_cast<int>(seen_.keyframes().size()) > maxFrames()) {
    seen_.removeKeyframe(seen_.keyframes().begin()->first);
  }
}

// One marker that has moved is not the lens: the better half of them counts.
void LensWatch::noteFit(const FrameTime& time, const Transform& T_w_c,
                        std::span<const KnownMarker> known) {
  std::array<double, 8> misfits{};
  const std::size_t count = std::min(known.size(), misfits.size());
  for (std::size_t i = 0; i < count; ++i) {
    misfits[i] =
        PoseOptimizer::markerChi2(known[i], T_w_c).value_or(options_.watch.worst_fit * 8.0);
  }
  std::sort(misfits.begin(), misfits.begin() + static_cast<std::ptrdiff_t>(count));
  const double fit = std::min(misfits[(count - 1) / 2] / 8.0, options_.watch.worst_fit);
  const LensWatchOptions& watch = options_.watch;
  of_late_ += (fit - of_late_) / watch.late_frames;
  const bool contradicts = frames_ >= watch.usual_frames &&
                           of_late_ > watch.doubt_ratio * std::max(usual_, watch.least_usual);
  if (!contradicts) {
    if (estimate_) return;  // which tells more
    if (doubted_since_ns_ > 0 && map_grows_) forget();
    doubted_since_ns_ = 0;
    usual_ += (fit - usual_) / std::min(++frames_, watch.usual_frames);
  } else if (doubted_since_ns_ == 0) {
    doubted_since_ns_ = time.monotonic_ns;
    forget();
  }
}

bool LensWatch::isAnotherView(const FrameTime& time, const Transform& T_w_c,
                              std::span<const KnownMarker> known) const {
  if (seen_.keyframes().empty()) return true;
  const Keyframe& last = seen_.keyframes().rbegin()->second;
  const LensWatchOptions& watch = options_.watch;
  if (time.monotonic_ns - last.monotonic_ns < watch.min_interval_ns) return false;
  const double depth_m = (known.front().T_w_m.p - T_w_c.p).norm();
  return rotationDistance(T_w_c.R, last.T_w_c.R) > watch.min_turn_rad ||
         (T_w_c.p - last.T_w_c.p).norm() > watch.min_turn_rad * depth_m;
}

void LensWatch::work(double cost, const RollingShutterEstimator& shutter,
                     const BundleOptions& optimization) {
  // A rolling shutter that is only just being learned looks like a lens that has changed; and so
  // does a lens that is itself only being learned, in a map that grows with it.
  if (map_grows_ && !shutter.isGiven() && shutter.seconds() != 0.0) return;
  if (map_grows_ && knowledge_->state == LensState::kLearning) return;
  if (!estimate_ && asks() && static_cast<int>(seen_.keyframes().size()) >= nextFrames()) {
    estimated_from_ = nextFrames();
    const CameraModel before = map_grows_ ? asUnmeasured(*camera_) : *camera_;  // it has changed
    LensProblem problem{.in_use = *camera_,
                        .expected = looksForChange() ? before : knowledge_->given,
                        .prior = options_.prior,
                        .readout_s = shutter.seconds(),
                        .readout_known = shutter.isGiven(),
                        .max_keyframes = maxFrames(),
                        .any_model = !looksForChange(),
                        .any_beginning = knowledge_->state == LensState::kLearning,
                        // A map that grows has begun to bend to what has changed.
                        .markers_held = !map_grows_,
                        .perhaps_bent = map_grows_,
                        .contradicts_chi2 = options_.min_chi2};
    estimate_.emplace([&](Budget* budget) {
      return estimateLens(seen_, markers_, problem, optimization, budget);
    });
  }
  if (estimate_) (void)estimate_->advance(cost);
}

bool LensWatch::believes(const LensEstimate& estimate) const {
  if (!(coversImage(estimate.camera) >= coversImage(*camera_))) return false;
  if (!looksForChange() &&
      estimate.focalShare() < options_.better_known * knowledge_->focalShare()) {
    return true;
  }
  // What it replaces took a calibration's place in a known map, and was learned from what was seen
  // through that.
  if (times_seen_ > 0) return true;
  const double material =
      map_grows_ ? options_.watch.sure_rms * options_.material_rms : options_.material_rms;
  const double change = std::abs(estimate.camera.focalLength() / camera_->focalLength() - 1.0);
  if (map_grows_ && change > options_.watch.max_change) return false;
  // Markers that are elsewhere take up most of what another lens leaves; but no lens takes up
  // anything of what a bend leaves once they are.
  if (estimate.chi2_beyond_bend < options_.min_chi2) return false;
  return lensChange(estimate, *camera_) > options_.min_chi2 &&
         (estimate.rms_after_px < material * estimate.rms_before_px ||
          estimate.evidence.chi2() > options_.min_chi2);
}

bool LensWatch::collect(const RollingShutterEstimator& shutter) {
  if (!estimate_ || !estimate_->done()) return false;
  const std::optional<LensEstimate> found = estimate_->take();
  estimate_.reset();
  const bool believed = found && believes(*found);
  is_undecided_ =
      found && !believed && !map_grows_ && lensChange(*found, *camera_) > options_.min_chi2;
  if (!believed) return false;
  LensKnowledge& known = *knowledge_;
  if (map_grows_) {
    known.earlier.push_back({*camera_, doubted_since_ns_});
    known.since_ns = doubted_since_ns_;
  }
  known.adopt(found->camera, found->covariance, found->rms_before_px, found->rms_after_px,
              options_.prior, options_.learned_focal_share);
  *camera_ = found->camera;
  doubted_since_ns_ = 0;
  of_late_ = usual_;
  if (map_grows_) {
    forget();
  } else if (options_.given && shutter.seconds() != 0.0) {
    seeAgain();
  } else {
    undistortAgain(*camera_, shutter.seconds(), &seen_);
  }
  return true;
}

}  // namespace waymark::slam
