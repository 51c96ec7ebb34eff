#include "slam/loop_closure/loop_closure_manager.h"

#include <algorithm>
#include <utility>
#include <variant>

#include "slam/loop_closure/loop_adoption.h"
#include "slam/loop_closure/loop_evidence.h"

namespace waymark::slam {

LoopJunction LoopClosureManager::closeOrJoin(const Map& map, double residual_sigma,
                                             const TrackedFrame& frame,
                                             std::span<const MarkerDetection> fitting) {
  if (frame.loop.empty() || !local_.reference()) return {};
  const Transform& T_w_c = frame.solution.T_w_c;
  const auto [witnesses, young] = splitByViews(map, frame.loop, T_w_c);
  if (witnesses.empty()) return join({}, young, frame);
  const auto areEnough = [&](const std::vector<int>& agreeing) {
    return static_cast<double>(agreeing.size()) >
           options_.min_joining_share * static_cast<double>(witnesses.size());
  };
  const std::vector<int> agreeing = fittingMarkers(witnesses, T_w_c, residual_sigma);
  const bool ends_agree = areEnough(agreeing);
  if (areEnough(fittingMarkers(witnesses, T_w_c, 1.0))) return join(agreeing, young, frame);
  const bool may_start = !isClosing() && frames_to_next_attempt_ == 0;
  if (!isClosing() && frames_to_next_attempt_ > 0) --frames_to_next_attempt_;
  if (isLarge(map)) {
    const std::vector<int> explained = explainedByDrift(map, witnesses, T_w_c);
    if (areEnough(explained)) {
      if (may_start) {
        (void)start(map, witnesses, frame, fitting, Cause::kOtherPlace, ends_agree, true);
        frames_to_next_attempt_ = options_.frames_between_attempts;
      }
      return join(explained, young, frame);
    }
  }
  const bool started =
      may_start && start(map, witnesses, frame, fitting, Cause::kOtherPlace, ends_agree, false);
  if (started) return {};
  if (!isClosing() && ends_agree) return join(agreeing, young, frame);
  if (!may_start) recordContradiction(frame);
  return {};
}

bool LoopClosureManager::confirmMoved(const Map& map, const TrackedFrame& frame,
                                      std::span<const MarkerDetection> fitting) {
  if (!screening_->suspectsMoved(map)) {
    misfits_rejected_ = false;
    return false;
  }
  if (isClosing()) return false;  // its end will tell
  if (std::exchange(misfits_rejected_, false) || !local_.reference()) return true;
  std::vector<KnownMarker> misfits;
  for (std::size_t i = 0; i < frame.eligible.size(); ++i) {
    if (!frame.solution.inlier[i]) misfits.push_back(frame.eligible[i]);
  }
  return misfits.empty() || !start(map, misfits, frame, fitting, Cause::kMisfits, false, true);
}

void LoopClosureManager::relaxInIdleTime(const Map& map, bool idle) {
  idle_frames_ = idle && bent_ && !work_ ? idle_frames_ + 1 : 0;
  if (idle_frames_ < options_.frames_before_relaxing) return;
  work_ = std::make_unique<Work>(Facts{.cause = Cause::kBentMap}, [&](Budget* budget) {
    return relaxMap(map, markers_, options_, budget);
  });
}

void LoopClosureManager::work(double cost) {
  if (work_) (void)work_->task.advance(std::max(cost, work_->facts.min_cost));
}

std::optional<Transform> LoopClosureManager::collect(Map* map) {
  if (!isDone()) return std::nullopt;
  const LoopOutcome outcome = work_->task.take();
  const Facts facts = work_->facts;
  const auto near_camera = work_->place_lost ? local_.reference() : std::nullopt;
  spent_ = std::move(work_);
  if (const auto* rejection = std::get_if<LoopRejection>(&outcome)) {
    recordRejection(facts, *rejection);
    return std::nullopt;
  }
  if (const auto* relaxed = std::get_if<RelaxedMap>(&outcome)) {
    const auto T_new_old = adopt(*relaxed, near_camera, map);
    // Once more, where the coordinates are others by now, or a closing frame had a say that was
    // refused.
    bent_ = !T_new_old || facts.cause != Cause::kBentMap;
    return T_new_old;
  }
  const auto adopted = adopt(std::get<ClosedLoop>(outcome), near_camera, map);
  if (!adopted) return std::nullopt;  // the coordinates are others by now
  bent_ = facts.regional;
  ++counters_->loop_closures;
  if (adopted->added) ++counters_->keyframes_added;
  screening_->forgetDisagreements();
  contradicting_marker_ = -1;
  return adopted->T_new_old;
}

// False when the markers do not say where the frame is.
bool LoopClosureManager::start(const Map& map, std::span<const KnownMarker> markers,
                               const TrackedFrame& frame, std::span<const MarkerDetection> fitting,
                               Cause cause, bool ends_agree, bool region) {
  LoopFrame candidate = loopEvidence(keyframeOf(frame, fitting), *local_.reference(), markers,
                                     optimizer_, camera_.focalLength(), relocalization_);
  if (candidate.expected.empty()) return false;
  const int only_marker = markers.size() == 1 ? markers[0].detection->id : -1;
  const bool regional = region && isLarge(map) && !std::exchange(whole_map_next_, false);
  const Facts facts{cause, only_marker, ends_agree, regional, costToCloseInTime(map)};
  work_ = std::make_unique<Work>(facts, [&](Budget* budget) {
    return regional ? relaxRegion(map, std::move(candidate), markers_, options_, budget)
                    : closeLoop(map, std::move(candidate), markers_, options_, budget);
  });
  return true;
}

double LoopClosureManager::costToCloseInTime(const Map& map) const {
  const auto views = static_cast<double>(map.viewCount());
  return std::min(options_.cost_per_view * views / options_.frames_to_close,
                  options_.max_cost_per_frame);
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

// What a map has drifted between two of its ends is not known; it is not more than both may be away
// from where they should be.
std::vector<int> LoopClosureManager::explainedByDrift(const Map& map,
                                                      std::span<const KnownMarker> markers,
                                                      const Transform& T_w_c) const {
  std::vector<int> explained;
  for (KnownMarker marker : markers) {
    marker.covariance += 2.0 * map.find(marker.detection->id)->world_covariance;
    if (optimizer_.explains(marker, T_w_c, 1.0)) explained.push_back(marker.detection->id);
  }
  return explained;
}

LoopClosureManager::Ends LoopClosureManager::splitByViews(const Map& map,
                                                          std::span<const KnownMarker> markers,
                                                          const Transform& T_w_c) const {
  Ends ends;
  for (const KnownMarker& marker : markers) {
    const int id = marker.detection->id;
    const auto views = static_cast<int>(map.viewsOf(id).size());
    if (isLarge(map) && views < options_.sure_views && optimizer_.isNear(marker, T_w_c)) {
      ends.young.push_back(id);
    } else {
      ends.witnesses.push_back(marker);
    }
  }
  return ends;
}

// The young ones come along.
LoopJunction LoopClosureManager::join(const std::vector<int>& agreeing,
                                      const std::vector<int>& young, const TrackedFrame& frame) {
  LoopJunction junction{.joins = true};
  for (const KnownMarker& marker : frame.loop) {
    const int id = marker.detection->id;
    if (std::ranges::binary_search(young, id)) {
      junction.joined.push_back(*marker.detection);
      continue;
    }
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
  if (facts.cause == Cause::kBentMap) {
    bent_ = false;  // it is as good as it can be
    return;
  }
  if (facts.regional && (facts.cause == Cause::kOtherPlace || facts.only_marker < 0)) {
    whole_map_next_ = true;
    return;
  }
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
