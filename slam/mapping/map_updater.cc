#include "slam/mapping/map_updater.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>

#include "base/elapsed.h"

namespace waymark::slam {

Transform MapUpdater::begin(const Start& start, Map* map) {
  return mapper_.begin(start, map, counters_);
}

// A frame's motion is that since the frame before; what the next one shows is half of a keyframe's,
// too, as it is of its middle row's time. (Of the first keyframes, which came before any motion was
// known, it is all; true where there were such ones.) Else a rolling shutter's corners stay off by
// what the motion has changed.
bool MapUpdater::tellKeyframesTheirMotion(const TrackedFrame& frame, Map* map) {
  const auto& keyframes = map->keyframes();
  const KeyframeId fresh =
      std::exchange(first_fresh_, keyframes.empty() ? 0 : keyframes.rbegin()->first + 1);
  if (frame.method != TrackingMethod::kPredicted || !isCertain(frame)) return false;
  bool news = false;
  for (auto it = keyframes.lower_bound(fresh); it != keyframes.end(); ++it) {
    const auto& [id, keyframe] = *it;
    const double after_s = secondsBetween(keyframe.monotonic_ns, frame.time.monotonic_ns);
    const Twist twist = twistBetween(keyframe.twist, frame.twist, after_s);
    if (twist == keyframe.twist) continue;
    news = news || keyframe.twist.isZero(0.0);
    map->setKeyframeTwist(id, twist);
    rolling_shutter_->deskew(camera_, id, map);
  }
  return news;
}

MapGrowth MapUpdater::grow(const TrackedFrame& frame, Map* map) {
  MapGrowth growth;
  gaps_.leave();
  fitting_.assign(frame.fitting.begin(), frame.fitting.end());
  growth.map_changed = tellKeyframesTheirMotion(frame, map);
  const LoopJunction junction = loops_.closeOrJoin(*map, residualSigma(), frame, fitting_);
  if (junction.joins) {
    fitting_.insert(fitting_.end(), junction.joined.begin(), junction.joined.end());
    sortById(&fitting_);
  }
  growth.map_changed = screenMarkers(frame, map) || growth.map_changed;
  const Transform& T_w_c = frame.solution.T_w_c;
  // From one of a single marker's two poses, undecided, the map would learn either.
  const bool decided = fitting_.size() > 1 || isCertain(frame);
  const bool worth = decided && mapper_.wants(fitting_, T_w_c, *map);
  if (!fitting_.empty() && (junction.joins || worth)) {
    mapper_.insert(keyframeOf(frame, fitting_), map, counters_);
    growth.map_changed = growth.keyframe_added = true;
    for (const MarkerDetection& detection : fitting_) {
      screening_->checkReturned(detection.id, map, counters_);
    }
  } else {
    growth.map_changed = mapper_.catchUp(map, counters_) || growth.map_changed;
  }
  growth.fitting = fitting_;
  return growth;
}

std::optional<int> MapUpdater::growThroughGap(CarriedFrame frame, Map* map) {
  carried_.assign(frame.detections.begin(), frame.detections.end());
  rolling_shutter_->deskew(camera_, *map, frame.T_w_c, frame.twist, &carried_);
  frame.detections = carried_;
  const auto joint = gaps_.offer(frame, *map, residualSigma());
  if (!joint) return std::nullopt;
  mapper_.insert(*joint, map, counters_);
  return joint->marker.id;
}

bool MapUpdater::growAtArrival(const TrackedFrame& frame, CarriedFrame carried, Map* map) {
  carried.detections = frame.fitting;
  const auto keyframe = gaps_.arrive(carried, *map);
  if (!keyframe) return false;
  mapper_.insert(*keyframe, map, counters_);
  ++counters_->linked_gaps;
  return true;
}

bool MapUpdater::growAfterGap(const TrackedFrame& frame, std::optional<CarriedFrame> carried,
                              Map* map) {
  if (!carried) {
    gaps_.endNearing();
    return false;
  }
  carried->detections = frame.fitting;
  const auto keyframe = gaps_.comeNearer(*carried, *map);
  if (!keyframe) return false;
  mapper_.insert(*keyframe, map, counters_);
  ++counters_->linked_nearer;
  return true;
}

bool MapUpdater::growByPicture(const AwaitedFrame& frame, const LateResult& seen, Map* map) {
  const auto joint = pictures_.offer(frame, seen, *map);
  if (joint) mapper_.insert(*joint, map, counters_);
  return joint.has_value();
}

// What the screening has noticed goes into the map, and out of the frame. True when the map
// changed.
bool MapUpdater::screenMarkers(const TrackedFrame& frame, Map* map) {
  bool changed = screening_->banDuplicates(map, counters_);
  if (!lens_->inDoubt(*map) && loops_.confirmMoved(*map, frame, fitting_)) {
    changed = screening_->quarantineMoved(map, counters_) || changed;
  }
  if (!changed) return false;
  std::erase_if(fitting_, [&](const MarkerDetection& d) {
    const MapMarker* marker = map->find(d.id);
    return marker != nullptr && marker->state == MarkerState::kBanned;
  });
  return true;
}

// What local optimization leaves is for what is larger than the neighbourhood of a keyframe.
void MapUpdater::work(double budget, const Map& map) {
  loops_.letGoOfSpent();
  const bool local_only = loops_.idle() && shutterIdle(map) && lens_->idle(map);
  loops_.relaxInIdleTime(map, local_only && mapper_.idle());
  const double for_local = local_only ? budget : options_.mapper.work_share * budget;
  const double unspent = std::max(mapper_.work(for_local, map), 0.0);
  const double rest = budget - for_local + unspent;
  if (!lens_->idle(map)) {
    lens_->work(rest, *rolling_shutter_, map, options_.loops.optimization);
  } else if (loops_.idle() && asksShutter()) {
    rolling_shutter_->work(rest, camera_, map, options_.loops.optimization);
  } else if (!loops_.idle()) {
    loops_.work(rest);
  }
}

FinishedWork MapUpdater::collect(Map* map) {
  FinishedWork finished;
  const auto add = [&](const std::optional<Transform>& T_new_old) {
    if (T_new_old) finished.T_new_old.push_back(*T_new_old);
    return T_new_old.has_value();
  };
  add(mapper_.takeWorldMotion());
  add(mapper_.collect(map, counters_));
  if (lens_->isDone()) {
    finished.lens_changed =
        add(lens_->collect(*rolling_shutter_, options_.loops.optimization, map));
  }
  if (asksShutter()) {
    add(rolling_shutter_->collect(camera_, options_.loops.optimization, map));
  }
  const std::uint64_t closures = counters_->loop_closures;
  add(loops_.collect(map));
  finished.loop_closed = counters_->loop_closures != closures;
  for (const Transform& T_new_old : finished.T_new_old) pictures_.moveWorld(T_new_old);
  return finished;
}

}  // namespace waymark::slam
