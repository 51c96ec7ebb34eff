#include "slam/loop_closure/loop_keeper.h"

#include <algorithm>
#include <utility>
#include <variant>

#include "slam/loop_closure/loop_evidence.h"

namespace waymark::slam {

void LoopKeeper::meet(const Map& map, double noise, Sight* sight) {
  const std::vector<KnownMarker>& loop = sight->known.loop;
  if (loop.empty() || !detector_.reference()) return;
  const Transform& T_w_c = sight->solution.T_w_c;
  const std::vector<int> agreeing = fittingMarkers(loop, T_w_c, noise);
  const bool ends_agree = 2 * agreeing.size() > loop.size();
  if (2 * fittingMarkers(loop, T_w_c, 1.0).size() > loop.size()) {
    join(agreeing, sight);
  } else if (work_) {
    recordContradiction(*sight);
  } else if (frames_to_next_attempt_ > 0) {
    --frames_to_next_attempt_;
    if (ends_agree) join(agreeing, sight);
    if (!ends_agree) recordContradiction(*sight);
  } else if (!begin(map, loop, *sight, Cause::kOtherPlace, ends_agree) && ends_agree) {
    join(agreeing, sight);
  }
}

bool LoopKeeper::haveMoved(const Map& map, const Sight& sight) {
  if (!watch_->suspectsMoved(map)) {
    misfits_refused_ = false;
    return false;
  }
  if (work_) return false;  // its end will tell
  if (std::exchange(misfits_refused_, false) || !detector_.reference()) return true;
  std::vector<KnownMarker> misfits;
  for (std::size_t i = 0; i < sight.known.eligible.size(); ++i) {
    if (!sight.solution.inlier[i]) misfits.push_back(sight.known.eligible[i]);
  }
  return misfits.empty() || !begin(map, misfits, sight, Cause::kMisfits, false);
}

void LoopKeeper::work(double units) {
  if (work_) (void)work_->task.advance(std::max(units, work_->facts.least_units));
}

std::optional<Transform> LoopKeeper::collect(Map* map) {
  if (!isDone()) return std::nullopt;
  const LoopOutcome outcome = work_->task.take();
  const Facts facts = work_->facts;
  work_.reset();
  if (const auto* refusal = std::get_if<LoopRefusal>(&outcome)) {
    recordRefusal(facts, *refusal);
    return std::nullopt;
  }
  const auto& closed = std::get<ClosedLoop>(outcome);
  if (!adopt(closed, map)) return std::nullopt;  // the coordinates are others by now
  ++counters_->loop_closures;
  ++counters_->keyframes_added;
  watch_->forget();
  contradicting_marker_ = -1;
  return closed.closing.T_w_c * closed.T_closing_was.inverse();
}

// False when the markers do not say where the frame is.
bool LoopKeeper::begin(const Map& map, std::span<const KnownMarker> markers, const Sight& sight,
                       Cause cause, bool ends_agree) {
  LoopFrame candidate =
      loopEvidence(sight.frameAt(sight.solution.T_w_c), *detector_.reference(), markers, optimiser_,
                   camera_.focalLength(), options_.tracking.relocalisation);
  if (candidate.expected.empty()) return false;
  const int only_marker = markers.size() == 1 ? markers[0].detection->id : -1;
  const Facts facts{cause, only_marker, ends_agree, unitsToCloseInTime(map)};
  work_.emplace(facts, [&](Allowance* allowance) {
    return closeLoop(map, std::move(candidate), options_.markers, options_.loops, allowance);
  });
  return true;
}

double LoopKeeper::unitsToCloseInTime(const Map& map) const {
  std::size_t views = 0;
  for (const auto& [id, keyframe] : map.keyframes()) views += keyframe.detections.size();
  return options_.loops.units_per_view * static_cast<double>(views) /
         options_.loops.frames_to_close;
}

// Ids of the markers that a pose explains.
std::vector<int> LoopKeeper::fittingMarkers(std::span<const KnownMarker> markers,
                                            const Transform& T_w_c, double noise) const {
  std::vector<int> fitting;
  for (const KnownMarker& marker : markers) {
    if (optimiser_.explains(marker, T_w_c, noise)) fitting.push_back(marker.detection->id);
  }
  return fitting;
}

void LoopKeeper::join(const std::vector<int>& agreeing, Sight* sight) {
  for (const KnownMarker& marker : sight->known.loop) {
    const int id = marker.detection->id;
    const bool agrees = std::ranges::binary_search(agreeing, id);
    watch_->record(id, agrees, sight->time.monotonic_ns);
    if (agrees) sight->fitting.push_back(*marker.detection);
    if (!agrees) ++counters_->rejected_markers;
  }
  sortById(&sight->fitting);
  sight->closes_loop = true;
  ++counters_->loops_without_drift;
}

// One marker that contradicts all others, whose loop was refused for that: it moved, or hangs
// twice, more likely than they did. The watch hears of every frame, not only of the attempts.
void LoopKeeper::recordContradiction(const Sight& sight) {
  const std::vector<KnownMarker>& loop = sight.known.loop;
  if (loop.size() != 1 || loop[0].detection->id != contradicting_marker_) return;
  if (sight.solution.inliers < 2) return;
  watch_->record(contradicting_marker_, false, sight.time.monotonic_ns);
}

void LoopKeeper::recordRefusal(const Facts& facts, LoopRefusal refusal) {
  if (facts.cause == Cause::kMisfits) {
    misfits_refused_ = true;
    return;
  }
  constexpr int kFramesBetweenAttempts = 10;
  frames_to_next_attempt_ = kFramesBetweenAttempts;
  if (facts.ends_agree) return;
  ++counters_->loops_refused;
  contradicting_marker_ = refusal == LoopRefusal::kContradicted ? facts.only_marker : -1;
}

}  // namespace waymark::slam
