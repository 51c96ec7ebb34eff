#include "slam/mapping/mapper.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "slam/camera_pose/known_marker.h"
#include "slam/map/world_reference.h"
#include "slam/mapping/camera_doubt.h"
#include "slam/optimization/map_fit.h"
#include "slam/option_checks.h"

namespace waymark::slam {

namespace {

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kResolve = 5.0;
constexpr double kResolveView = 15.0;
constexpr double kResolveViewPair = 1.0;
constexpr double kRefine = 5.0;
constexpr double kRefineView = 3.0;

void queue(int id, std::vector<int>* ids) {
  if (std::ranges::find(*ids, id) == ids->end()) ids->push_back(id);
}

int takeFirst(std::vector<int>* ids) {
  const int id = ids->front();
  ids->erase(ids->begin());
  return id;
}

// At most so many of them: the first, the last, and evenly between.
std::vector<KeyframeId> spread(std::span<const KeyframeId> ids, int most) {
  const auto count = std::min(ids.size(), static_cast<std::size_t>(most));
  std::vector<KeyframeId> some(count);
  for (std::size_t i = 0; i < count; ++i) {
    some[i] = ids[count < 2 ? 0 : i * (ids.size() - 1) / (count - 1)];
  }
  return some;
}

bool fixesWorld(const MarkerOptions& markers, int marker_id) {
  return markers.origin_marker == marker_id ||
         std::ranges::find(markers.anchors, marker_id, &Anchor::id) != markers.anchors.end();
}

}  // namespace

std::string MapperOptions::invalidReason() const {
  return firstReason({
      keyframes.invalidReason(),
      marker_pose.invalidReason(),
      gaps.invalidReason(),
      pictures.invalidReason(),
      local_map.invalidReason(),
      local_optimization.invalidReason(),
      firstUnmet({
          {isShare(work_share), "the share of local optimization must be from 0 to 1"},
          {second_look_views >= 2, "a second look at a marker needs at least 2 views"},
          {most_views >= 3, "a marker must be decided from at least 3 views"},
          {young_views >= 0, "the views of a young marker must not be negative"},
          {isPositive(marker_cost), "the cost of a keyframe's markers must be positive"},
      }),
  });
}

Transform Mapper::begin(const Start& start, Map* map, Counters* counters) {
  KeyframeId last = -1;
  for (const Keyframe& keyframe : start.keyframes) {
    for (const MarkerDetection& detection : keyframe.detections) {
      map->addMarker(detection.id, markers_.sizeOf(detection.id));
    }
    last = map->addKeyframe(keyframe);
    ++counters->keyframes_added;
  }
  for (const InitialMarker& marker : start.markers) {
    pose(marker.id, marker.T_w_m, marker.other_T_w_m, map);
  }
  fixWorld(map);
  world_moved_.reset();  // nothing else was in the map's coordinates yet
  residual_sigma_ =
      optimizeLocally(map, last, markers_, options_.local_optimization).residual_sigma;
  return map->keyframes().at(last).T_w_c;
}

bool Mapper::wants(std::span<const MarkerDetection> detections, const Transform& T_w_c,
                   const Map& map) const {
  const double depth_m = medianDepth(map, detections, T_w_c).value_or(0.0);
  const bool resolved = !unambiguousNewMarkers(detections, T_w_c, map).empty();
  return keyframeReason(map, detections, T_w_c, depth_m, resolved, options_.keyframes) !=
         KeyframeReason::kNone;
}

void Mapper::insert(const Keyframe& frame, Map* map, Counters* counters) {
  const std::vector<InitialMarker> unambiguous =
      unambiguousNewMarkers(frame.detections, frame.T_w_c, *map);
  for (const MarkerDetection& detection : frame.detections) {
    map->addMarker(detection.id, markers_.sizeOf(detection.id));
  }
  const KeyframeId newest = map->addKeyframe(frame);
  ++counters->keyframes_added;
  for (const InitialMarker& marker : unambiguous) {
    pose(marker.id, marker.T_w_m, marker.other_T_w_m, map);  // Eq. 23
  }
  for (const MarkerDetection& detection : frame.detections) {
    queue(detection.id, &to_resolve_);
    queue(detection.id, &to_refine_);
  }
  seeToMarkers(map, counters);
  (void)culler_.cull(map, newest);
  wanted_ = newest;
}

bool Mapper::catchUp(Map* map, Counters* counters) {
  if (to_resolve_.empty() && to_refine_.empty()) return false;
  seeToMarkers(map, counters);
  return true;
}

void Mapper::seeToMarkers(Map* map, Counters* counters) {
  double left = options_.marker_cost;
  while (left > 0.0 && !to_resolve_.empty()) {
    left -= resolve(takeFirst(&to_resolve_), map, counters);
  }
  while (left > 0.0 && !to_refine_.empty()) left -= refineYoung(takeFirst(&to_refine_), map);
  fixWorld(map);
}

void Mapper::insert(const GapJoint& joint, Map* map, Counters* counters) {
  for (const Keyframe& keyframe : joint.keyframes) insert(keyframe, map, counters);
  pose(joint.marker.id, joint.marker.T_w_m, joint.marker.other_T_w_m, map);
  ++counters->linked_markers;
}

void Mapper::insert(const PictureJoint& joint, Map* map, Counters* counters) {
  if (joint.moved) {
    map->quarantine(joint.id);
    ++counters->quarantined_markers;
    return;
  }
  if (joint.T_w_m) {
    map->place(joint.id, *joint.T_w_m, {}, joint.covariance);
    ++counters->mapped_pictures;
  }
  for (const Keyframe& keyframe : joint.keyframes) insert(keyframe, map, counters);
}

// Section 4.7.
double Mapper::work(double cost, const Map& map) {
  if (!local_ && wanted_) {
    local_keyframe_ = *std::exchange(wanted_, std::nullopt);
    if (!map.keyframes().contains(local_keyframe_)) return cost;
    local_.emplace([&](Budget* budget) {
      return optimizeSubproblem(map, localMap(map, local_keyframe_, options_.local_map), markers_,
                                options_.local_optimization, budget);
    });
  }
  if (!local_ || local_->done()) return cost;
  (void)local_->advance(cost);
  return local_->left();
}

std::optional<Transform> Mapper::collect(Map* map, Counters* counters) {
  if (!isDone()) return std::nullopt;
  const MapCorrection correction = local_->take();
  local_.reset();
  auto T_new_old = applyAround(local_keyframe_, correction, map);
  if (!T_new_old) {
    if (!wanted_) wanted_ = local_keyframe_;  // once more, in the new coordinates
    return std::nullopt;
  }
  residual_sigma_ = correction.summary.residual_sigma;
  counters->gated_views += static_cast<std::uint64_t>(correction.summary.gated_views);
  counters->gated_constraints += static_cast<std::uint64_t>(correction.summary.gated_constraints);
  return T_new_old;
}

// Until the optimizations come to it, a marker is where its first view has put it. What it cost.
double Mapper::refineYoung(int marker_id, Map* map) const {
  const MapMarker* const marker = map->findPosed(marker_id);
  const auto views = static_cast<int>(map->viewsOf(marker_id).size());
  const bool young = views >= 2 && views <= options_.young_views;
  if (marker == nullptr || !young || fixesWorld(markers_, marker_id)) return 0.0;
  if (const auto T_w_m = optimizeMarker(*map, marker_id, options_.local_optimization)) {
    pose(marker_id, *T_w_m, marker->other_T_w_m, map);
  }
  return kRefine + kRefineView * static_cast<double>(views);
}

// A new pose is as sure as the views that it comes from.
void Mapper::pose(int marker_id, const Transform& T_w_m, const std::optional<Transform>& other,
                  Map* map) const {
  map->place(marker_id, T_w_m, other, markerCovariance(*map, marker_id, T_w_m, residual_sigma_));
}

// Rules 1 and 2a: markers without a pose that this frame alone decides. One in quarantine has to
// convince from several places.
std::vector<InitialMarker> Mapper::unambiguousNewMarkers(
    std::span<const MarkerDetection> detections, const Transform& T_w_c, const Map& map) const {
  std::vector<InitialMarker> markers;
  for (const MarkerDetection& detection : detections) {
    const MapMarker* marker = map.find(detection.id);
    if (marker != nullptr && marker->state != MarkerState::kUnresolved) continue;
    const auto square = estimateSquarePose(detection, markers_.sizeOf(detection.id), focal_px_,
                                           options_.marker_pose.square);
    if (!square || !square->unambiguous(options_.marker_pose.ambiguity_ratio)) continue;
    markers.push_back({detection.id, T_w_c * square->T_c_m[0], T_w_c * square->T_c_m[1]});
  }
  return markers;
}

void Mapper::resolveAll(Map* map) {
  const Subproblem whole = runToCompletion(
      [&](Budget* a) { return buildSubproblem(*map, wholeMap(*map), markers_, a); });
  residual_sigma_ =
      runToCompletion([&](Budget* a) { return fitOf(whole.problem, a); }).residual_sigma;
  for (const auto& [id, known] : map->markers()) {
    if (known.T_w_m || known.state == MarkerState::kBanned ||
        known.state == MarkerState::kElsewhere) {
      continue;
    }
    // Views from before it moved, or of cameras that are in the wrong place, go one by one.
    const auto fromAllViews = [&] {
      return resolution(id, map->viewsOf(id), options_.marker_pose.min_views, *map);
    };
    MarkerResolution found = fromAllViews();
    while (found.verdict == ResolverVerdict::kContradictory) {
      map->removeViews(id, map->viewsOf(id).subspan(found.worst_view, 1));
      found = fromAllViews();
    }
    if (found.verdict == ResolverVerdict::kResolved) pose(id, found.T_w_m, found.other_T_w_m, map);
  }
}

// Section 4.5 for one marker. What it cost.
double Mapper::resolve(int marker_id, Map* map, Counters* counters) const {
  const MapMarker& marker = map->markers().at(marker_id);
  if (marker.T_w_m && !marker.other_T_w_m) return 0.0;  // decided
  if (marker.state == MarkerState::kElsewhere) return 0.0;
  const bool second_look = marker.T_w_m.has_value();
  const std::vector<KeyframeId> views = spread(map->viewsOf(marker_id), options_.most_views);
  const auto looks = static_cast<double>(views.size());
  const double cost = kResolve + looks * (kResolveView + kResolveViewPair * looks);
  const MarkerResolution found =
      resolution(marker.id, views,
                 second_look ? options_.second_look_views : options_.marker_pose.min_views, *map);
  switch (found.verdict) {
    case ResolverVerdict::kTooFewViews:
    case ResolverVerdict::kUndecided:
      return cost;
    case ResolverVerdict::kContradictory:
      if (second_look) return 2.0 * cost;  // the poses' own gates deal with it
      // The oldest view may be from before it moved.
      map->quarantine(marker.id);
      map->removeViews(marker.id, map->viewsOf(marker.id).first(1));
      return 2.0 * cost;
    case ResolverVerdict::kResolved: {
      const bool flipped = second_look && rotationDistance(found.T_w_m.R, marker.other_T_w_m->R) <
                                              rotationDistance(found.T_w_m.R, marker.T_w_m->R);
      if (flipped) ++counters->flipped_markers;
      const bool enough =
          static_cast<int>(map->viewsOf(marker.id).size()) >= options_.marker_pose.min_views;
      const auto other = enough || flipped ? found.other_T_w_m : marker.other_T_w_m;
      pose(marker.id, second_look && !flipped ? *marker.T_w_m : found.T_w_m, other, map);
      return cost;
    }
  }
  return cost;
}

MarkerResolution Mapper::resolution(int marker_id, std::span<const KeyframeId> seen_from,
                                    int min_views, const Map& map) const {
  std::vector<MarkerView> views;
  for (const KeyframeId id : seen_from) {
    const Keyframe& keyframe = map.keyframes().at(id);
    views.push_back({keyframe.find(marker_id), keyframe.T_w_c});
  }
  MarkerResolverOptions options = options_.marker_pose;
  options.min_views = min_views;
  const double size_m = map.find(marker_id)->size_m;
  MarkerResolution found = resolveMarkerPose(views, size_m, focal_px_, residual_sigma_, options);
  if (found.verdict != ResolverVerdict::kContradictory) return found;
  // The cameras may be off, rather than the marker.
  std::vector<MarkerDetection> doubted;
  doubted.reserve(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Keyframe& keyframe = map.keyframes().at(seen_from[i]);
    doubted.push_back(withCameraDoubt(keyframe, marker_id, size_m, map, residual_sigma_));
    views[i].detection = &doubted.back();
  }
  const MarkerResolution doubtful =
      resolveMarkerPose(views, size_m, focal_px_, residual_sigma_, options);
  return doubtful.verdict == ResolverVerdict::kContradictory ? found : doubtful;
}

// Moves the map where the origin marker, or the first anchor that has a pose, says it is; or
// surveyed positions, once there are enough. Later ones pull in the optimizations.
void Mapper::fixWorld(Map* map) {
  if (world_fixed_) return;
  if (markers_.origin_marker) {
    if (const MapMarker* origin = map->findPosed(*markers_.origin_marker)) {
      world_moved_ = origin->T_w_m->inverse();
      map->moveWorld(*world_moved_);
      map->place(origin->id, Transform{}, origin->other_T_w_m, origin->covariance);  // exactly
      world_fixed_ = true;
    }
    return;
  }
  for (const Anchor& anchor : markers_.anchors) {
    if (const MapMarker* marker = map->findPosed(anchor.id)) {
      world_moved_ = anchor.T_w_m * marker->T_w_m->inverse();
      map->moveWorld(*world_moved_);
      world_fixed_ = true;
      return;
    }
  }
  if (positionsFixWorld(*map, markers_)) {
    world_moved_ = surveyedFromMap(*map, markers_);
    map->moveWorld(*world_moved_);
    world_fixed_ = true;
  }
}

}  // namespace waymark::slam
