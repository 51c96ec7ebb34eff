#include "slam/loop_closure/loop_closure_manager.h"

#include <algorithm>
#include <utility>
#include <variant>

#include "slam/loop_closure/loop_evidence.h"

namespace waymark::slam {

LoopJunction LoopClosureManager::closeOrJoin(const Map& map, double residual_sigma,
                                             const TrackedFrame& frame,
                                             std::span<const MarkerDetection> fitting) {
  if (frame.loop.empty() || !local_.reference()) return {};
  const Transform& T_w_c = frame.solution.T_w_c;
  const auto areEnough = [&](const std::vector<int>& agreeing) {
    return static_cast<double>(agreeing.size()) >
           options_.min_joining_share * static_cast<double>(frame.loop.size());
  };
  const std::vector<int> agreeing = fittingMarkers(frame.loop, T_w_c, residual_sigma);
  const bool ends_agree = areEnough(agreeing);
  if (areEnough(fittingMarkers(frame.loop, T_w_c, 1.0))) return join(agreeing, frame);
  if (work_) {
    recordContradiction(frame);
    return {};
  }
  if (frames_to_next_attempt_ > 0) {
    --frames_to_next_attempt_;
    if (ends_agree) return join(agreeing, frame);
    recordContradiction(frame);
    return {};
  }
  const bool started = start(map, frame.loop, frame, fitting, Cause::kOtherPlace, ends_agree);
  return !started && ends_agree ? join(agreeing, frame) : LoopJunction{};
}

bool LoopClosureManager::confirmMoved(const Map& map, const TrackedFrame& frame,
                                      std::span<const MarkerDetection> fitting) {
  if (!screening_->suspectsMoved(map)) {
    misfits_rejected_ = false;
    return false;
  }
  if (work_) return false;  // its end will tell
  if (std::exchange(misfits_rejected_, false) || !local_.reference()) return true;
  std::vector<KnownMarker> misfits;
  for (std::size_t i = 0; i < frame.eligible.size(); ++i) {
    if (!frame.solution.inlier[i]) misfits.push_back(frame.eligible[i]);
  }
  return misfits.empty() || !start(map, misfits, frame, fitting, Cause::kMisfits, false);
}

void LoopClosureManager::work(double cost) {
  if (work_) (void)work_->task.advance(std::max(cost, work_->facts.min_cost));
}

std::optional<Transform> LoopClosureManager::collect(Map* map) {
  if (!isDone()) return std::nullopt;
  const LoopOutcome outcome = work_->task.take();
  const Facts facts = work_->facts;
  work_.reset();
  if (const auto* rejection = std::get_if<LoopRejection>(&outcome)) {
    recordRejection(facts, *rejection);
    return std::nullopt;
  }
  const auto& closed = std::get<ClosedLoop>(outcome);
  if (!adopt(closed, map)) return std::nullopt;  // the coordinates are others by now
  ++counters_->loop_closures;
  ++counters_->keyframes_added;
  screening_->forgetDisagreements();
  contradicting_marker_ = -1;
  return closed.closing.T_w_c * closed.T_w_tracked.inverse();
}

// False when the markers do not say where the frame is.
bool LoopClosureManager::start(const Map& map, std::span<const KnownMarker> markers,
                               const TrackedFrame& frame, std::span<const MarkerDetection> fitting,
                               Cause cause, bool ends_agree) {
  LoopFrame candidate = loopEvidence(keyframeOf(frame, fitting), *local_.reference(), markers,
                                     optimizer_, camera_.focalLength(), relocalization_);
  if (candidate.expected.empty()) return false;
  candidate.is_near = cause == Cause::kMisfits;
  const int only_marker = markers.size() == 1 ? markers[0].detection->id : -1;
  const Facts facts{cause, only_marker, ends_agree, costToCloseInTime(map),
                    closesInPart(map, options_)};
  work_.emplace(facts, [&](Budget* budget) {
    return closeLoop(map, std::move(candidate), markers_, options_, budget);
  });
  return true;
}

double LoopClosureManager::costToCloseInTime(const Map& map) const {
  std::size_t views = 0;
  if (closesInPart(map, options_)) {
    views = static_cast<std::size_t>(options_.max_views);
  } else {
    for (const auto& [id, keyframe] : map.keyframes()) views += keyframe.detections.size();
  }
  return options_.cost_per_view * static_cast<double>(views) / options_.frames_to_close;
}

// Ids of the markers that a pose explains.
std::vector<int> LoopClosureManager::fittingMarkers(std::span<const KnownMarker> markers,
                                                    const Transform& T_w_c,
                                                    double residual_sigma) const {
  std::vector<int> fitting;
  for (const KnownMarker& marker : markers) {
    if (optimizer_.explains(marker, T_w_c, residual_sigma)) fitting.push_back(marker.detection->id);
  }
  return fitting;
}

LoopJunction LoopClosureManager::join(const std::vector<int>& agreeing, const TrackedFrame& frame) {
  LoopJunction junction{.joins = true};
  for (const KnownMarker& marker : frame.loop) {
    const int id = marker.detection->id;
    const bool agrees = std::ranges::binary_search(agreeing, id);
    screening_->record(id, agrees, frame.time.monotonic_ns);
    if (agrees) junction.joined.push_back(*marker.detection);
    if (!agrees) ++counters_->rejected_markers;
  }
  ++counters_->loops_without_drift;
  return junction;
}

// One marker that contradicts all others, whose loop was rejected for that: it moved, or hangs
// twice, more likely than they did. The screening hears of every frame, not only of the attempts.
void LoopClosureManager::recordContradiction(const TrackedFrame& frame) {
  if (frame.loop.size() != 1 || frame.loop[0].detection->id != contradicting_marker_) return;
  if (frame.solution.inliers < options_.min_witnesses) return;
  screening_->record(contradicting_marker_, false, frame.time.monotonic_ns);
}

void LoopClosureManager::recordRejection(const Facts& facts, LoopRejection rejection) {
  if (facts.cause == Cause::kMisfits) {
    misfits_rejected_ = true;
    return;
  }
  frames_to_next_attempt_ = options_.frames_between_attempts;
  if (facts.ends_agree) return;
  ++counters_->loops_refused;
  contradicting_marker_ = rejection == LoopRejection::kContradicted ? facts.only_marker : -1;
}

}  // namespace waymark::slam
