#include "slam/loop_closure/loop_closure_manager.h"

#include <algorithm>
#include <utility>
#include <variant>

#include "slam/loop_closure/loop_evidence.h"

namespace waymark::slam {

void LoopClosureManager::meet(const Map& map, double residual_sigma, FrameContext* context) {
  const std::vector<KnownMarker>& loop = context->known.loop;
  if (loop.empty() || !detector_.reference()) return;
  const Transform& T_w_c = context->solution.T_w_c;
  const std::vector<int> agreeing = fittingMarkers(loop, T_w_c, residual_sigma);
  const bool ends_agree = 2 * agreeing.size() > loop.size();
  if (2 * fittingMarkers(loop, T_w_c, 1.0).size() > loop.size()) {
    join(agreeing, context);
  } else if (work_) {
    recordContradiction(*context);
  } else if (frames_to_next_attempt_ > 0) {
    --frames_to_next_attempt_;
    if (ends_agree) join(agreeing, context);
    if (!ends_agree) recordContradiction(*context);
  } else if (!begin(map, loop, *context, Cause::kOtherPlace, ends_agree) && ends_agree) {
    join(agreeing, context);
  }
}

bool LoopClosureManager::haveMoved(const Map& map, const FrameContext& context) {
  if (!screening_->suspectsMoved(map)) {
    misfits_rejected_ = false;
    return false;
  }
  if (work_) return false;  // its end will tell
  if (std::exchange(misfits_rejected_, false) || !detector_.reference()) return true;
  std::vector<KnownMarker> misfits;
  for (std::size_t i = 0; i < context.known.eligible.size(); ++i) {
    if (!context.solution.inlier[i]) misfits.push_back(context.known.eligible[i]);
  }
  return misfits.empty() || !begin(map, misfits, context, Cause::kMisfits, false);
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
  screening_->forget();
  contradicting_marker_ = -1;
  return closed.closing.T_w_c * closed.T_w_tracked.inverse();
}

// False when the markers do not say where the frame is.
bool LoopClosureManager::begin(const Map& map, std::span<const KnownMarker> markers,
                               const FrameContext& context, Cause cause, bool ends_agree) {
  LoopFrame candidate =
      loopEvidence(context.frameAt(context.solution.T_w_c), *detector_.reference(), markers,
                   optimizer_, camera_.focalLength(), options_.tracking.relocalization);
  if (candidate.expected.empty()) return false;
  const int only_marker = markers.size() == 1 ? markers[0].detection->id : -1;
  const Facts facts{cause, only_marker, ends_agree, costToCloseInTime(map)};
  work_.emplace(facts, [&](Budget* budget) {
    return closeLoop(map, std::move(candidate), options_.markers, options_.loops, budget);
  });
  return true;
}

double LoopClosureManager::costToCloseInTime(const Map& map) const {
  std::size_t views = 0;
  for (const auto& [id, keyframe] : map.keyframes()) views += keyframe.detections.size();
  return options_.loops.cost_per_view * static_cast<double>(views) / options_.loops.frames_to_close;
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

void LoopClosureManager::join(const std::vector<int>& agreeing, FrameContext* context) {
  for (const KnownMarker& marker : context->known.loop) {
    const int id = marker.detection->id;
    const bool agrees = std::ranges::binary_search(agreeing, id);
    screening_->record(id, agrees, context->time.monotonic_ns);
    if (agrees) context->fitting.push_back(*marker.detection);
    if (!agrees) ++counters_->rejected_markers;
  }
  sortById(&context->fitting);
  context->closes_loop = true;
  ++counters_->loops_without_drift;
}

// One marker that contradicts all others, whose loop was rejected for that: it moved, or hangs
// twice, more likely than they did. The watch hears of every frame, not only of the attempts.
void LoopClosureManager::recordContradiction(const FrameContext& context) {
  const std::vector<KnownMarker>& loop = context.known.loop;
  if (loop.size() != 1 || loop[0].detection->id != contradicting_marker_) return;
  if (context.solution.inliers < 2) return;
  screening_->record(contradicting_marker_, false, context.time.monotonic_ns);
}

void LoopClosureManager::recordRejection(const Facts& facts, LoopRejection rejection) {
  if (facts.cause == Cause::kMisfits) {
    misfits_rejected_ = true;
    return;
  }
  constexpr int kFramesBetweenAttempts = 10;
  frames_to_next_attempt_ = kFramesBetweenAttempts;
  if (facts.ends_agree) return;
  ++counters_->loops_refused;
  contradicting_marker_ = rejection == LoopRejection::kContradicted ? facts.only_marker : -1;
}

}  // namespace waymark::slam
