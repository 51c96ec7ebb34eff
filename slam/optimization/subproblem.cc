#include "slam/optimization/subproblem.h"

#include <algorithm>
#include <functional>
#include <set>
#include <utility>

#include <Eigen/LU>

#include "base/sorted.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/map/world_reference.h"
#include "slam/optimization/constraint_frames.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kTakeView = 0.04;
constexpr double kTakePose = 0.4;
constexpr double kTakeCovariance = 1.0;
constexpr double kFindKeyframe = 1.5;
constexpr double kFindView = 0.1;
constexpr double kConstrainMarker = 3.0;  // its frames are fitted

// Markers and keyframes come in batches: a part of the usual size at once, as the map is then.
constexpr std::size_t kBatch = 500;

bool endsBatch(std::size_t index) { return index % kBatch == kBatch - 1; }

Task<Done> addMarkers(const Map& map, std::span<const int> ids, const MarkerOptions& markers,
                      Subproblem* part, Budget* budget) {
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (endsBatch(i)) co_await budget->spend(kTakePose * kBatch);
    const int id = ids[i];
    const MapMarker* const marker = map.findPosed(id);
    if (marker == nullptr) continue;
    part->markers.push_back({id, marker->former_poses.size()});
    part->problem.markers.push_back({*marker->T_w_m, markers.origin_marker == id});
    part->problem.marker_sizes_m.push_back(marker->size_m);
  }
  for (const Anchor& anchor : markers.anchors) {
    const int index = part->markerIndex(anchor.id);
    if (index < 0) continue;
    part->problem.priors.push_back(
        {index, anchor.T_w_m, independentInformation(anchor.sigma_m, anchor.sigma_rad)});
  }
  co_return Done{};
}

// Those that see one of the markers.
Task<Done> addKeyframes(const Map& map, std::span<const SubproblemMembers::Role> roles,
                        const MarkerOptions& markers, Subproblem* part, Budget* budget) {
  const bool first_is_world = firstKeyframeIsWorld(map, markers);
  const KeyframeId first = map.keyframes().empty() ? -1 : map.keyframes().begin()->first;
  part->problem.cameras.reserve(roles.size());
  part->keyframes.reserve(roles.size());
  auto next = map.keyframes().begin();
  for (std::size_t i = 0; i < roles.size(); ++i) {
    const auto& [id, held] = roles[i];
    if (endsBatch(i)) {
      co_await budget->spend(kTakePose * kBatch);
      next = map.keyframes().lower_bound(id);  // the one it was at may have been let go meanwhile
    }
    if (next == map.keyframes().end() || next->first != id) next = map.keyframes().lower_bound(id);
    if (next == map.keyframes().end() || next->first != id) continue;
    const Keyframe& keyframe = (next++)->second;
    const auto takesPart = [&](int marker) { return part->markerIndex(marker) >= 0; };
    const bool sees_some =
        std::ranges::any_of(keyframe.detections, takesPart, &MarkerDetection::id) ||
        std::ranges::any_of(keyframe.links, takesPart, &MarkerLink::marker);
    if (!sees_some) continue;
    part->problem.cameras.push_back({keyframe.T_w_c, held || (first_is_world && id == first)});
    part->keyframes.push_back(id);
  }
  co_return Done{};
}

void addLinks(const Keyframe& keyframe, int camera, Subproblem* part) {
  for (const MarkerLink& link : keyframe.links) {
    const int marker = part->markerIndex(link.marker);
    if (marker < 0 || keyframe.find(link.marker) != nullptr) continue;
    part->problem.links.push_back({camera, marker, link.T_c_m, link.covariance.inverse()});
  }
}

// Where the markers have more to obey than their views: the frames that some of these are tied to,
// and the others that are, held where they are.
class ConstraintsOfPart {
 public:
  ConstraintsOfPart(std::span<const ConstrainedMarker> markers, Subproblem* part)
      : markers_(markers), part_(part), index_(markers.size(), -1) {
    for (std::size_t i = 0; i < markers.size(); ++i) index_[i] = part->markerIndex(markers[i].id);
  }

  void add(const ConstraintFrame& frame) {
    const auto takesPart = [&](const ConstraintFrame::Member& member) {
      const int id = markers_[member.marker].id;
      return part_->markerIndex(id) >= 0;
    };
    if (std::ranges::none_of(frame.members, takesPart)) return;
    BundleProblem& problem = part_->problem;
    const auto camera = static_cast<int>(problem.cameras.size());
    problem.cameras.push_back({frame.T_w_f, frame.fixed});
    problem.gauges.push_back({camera, frame.gauge});
    for (const ConstraintFrame::Member& member : frame.members) {
      problem.constraints.push_back({camera, indexOf(member.marker), member.relations});
    }
  }

 private:
  int indexOf(std::size_t marker) {
    int& index = index_[marker];
    if (index >= 0) return index;
    index = static_cast<int>(part_->problem.markers.size());
    part_->problem.markers.push_back({markers_[marker].T_w_m, true});
    part_->problem.marker_sizes_m.push_back(markers_[marker].size_m);
    return index;
  }

  std::span<const ConstrainedMarker> markers_;
  Subproblem* part_;
  std::vector<int> index_;  // into the problem's markers; -1 for one that is not among them yet
};

Task<Done> addConstraints(const Map& map, const MarkerOptions& options, Subproblem* part,
                          Budget* budget) {
  const std::vector<ConstrainedMarker> markers = constrainedMarkers(map, options);
  co_await budget->spend(kConstrainMarker * static_cast<double>(markers.size()));
  const ConstraintFrames known =
      constraintFrames(options.constraints, markers, isInSurvey(map, options));
  ConstraintsOfPart constraints(markers, part);
  for (const ConstraintFrame& frame : known.frames) constraints.add(frame);
  for (const MeasuredDistance& distance : known.distances) {
    constraints.add(rulerOf(distance, markers));
  }
  part->problem.constraint_sources = static_cast<int>(known.sources.size());
  part->problem.constraint_gate = options.constraints.gate_sigmas;
  co_return Done{};
}

// The keyframes that say something about a marker: those that see it, and those linked to it.
void addViews(const Map& map, int marker_id, std::vector<KeyframeId>* views) {
  for (const auto of_marker : {map.viewsOf(marker_id), map.linkedFrom(marker_id)}) {
    views->insert(views->end(), of_marker.begin(), of_marker.end());
  }
}

struct Viewer {
  KeyframeId id = -1;
  int markers = 0;  // of those that are asked for
};

// views: a keyframe for each marker it sees; sorted here. Ascending.
std::vector<Viewer> countedViewers(std::vector<KeyframeId>* views) {
  std::ranges::sort(*views);
  std::vector<Viewer> viewers;
  for (const KeyframeId id : *views) {
    if (viewers.empty() || viewers.back().id != id) viewers.push_back({id, 0});
    ++viewers.back().markers;
  }
  return viewers;
}

// And the newest of those that see as many.
void sortMostFirst(std::vector<Viewer>* viewers) {
  std::ranges::sort(*viewers, std::greater(),
                    [](const Viewer& viewer) { return std::pair(viewer.markers, viewer.id); });
}

// Of the keyframes that share a marker with the given one so many that share the most, the newest
// first; ascending, itself among them.
std::vector<KeyframeId> nearest(const Map& map, KeyframeId keyframe, int keyframes) {
  std::vector<KeyframeId> views;  // once for each marker they share
  map.keyframes().at(keyframe).forEachMarker([&](int id) { addViews(map, id, &views); });
  std::vector<Viewer> viewers = countedViewers(&views);
  std::erase_if(viewers, [&](const Viewer& viewer) { return viewer.id == keyframe; });
  if (static_cast<int>(viewers.size()) >= keyframes) {
    sortMostFirst(&viewers);
    viewers.resize(static_cast<std::size_t>(keyframes) - 1);
  }
  std::vector<KeyframeId> near{keyframe};
  for (const Viewer& viewer : viewers) near.push_back(viewer.id);
  std::ranges::sort(near);
  return near;
}

// Other keyframes that see the markers: so many for each of them, those that see the most of them
// first.
std::vector<KeyframeId> holders(const Map& map, std::span<const int> markers,
                                std::span<const KeyframeId> near, int per_marker) {
  std::vector<KeyframeId> views;
  for (const int id : markers) {
    if (map.findPosed(id) != nullptr) addViews(map, id, &views);
  }
  std::vector<Viewer> candidates = countedViewers(&views);
  std::erase_if(candidates,
                [&](const Viewer& viewer) { return std::ranges::binary_search(near, viewer.id); });
  sortMostFirst(&candidates);
  std::vector<int> held(markers.size(), 0);
  std::vector<KeyframeId> holders;
  for (const Viewer& candidate : candidates) {
    bool wanted = false;
    const Keyframe& keyframe = map.keyframes().at(candidate.id);
    const auto each = [&](const auto& take) {
      keyframe.forEachMarker([&](int id) {
        const auto found = std::ranges::lower_bound(markers, id);
        if (found == markers.end() || *found != id) return;
        take(held[static_cast<std::size_t>(found - markers.begin())]);
      });
    };
    each([&](int& count) { wanted = wanted || count < per_marker; });
    if (!wanted) continue;
    each([](int& count) { ++count; });
    holders.push_back(candidate.id);
  }
  return holders;
}

}  // namespace

std::string LocalMapOptions::invalidReason() const {
  return firstUnmet({
      {max_keyframes >= 1, "a local optimization needs at least 1 keyframe"},
      {held_views >= 1, "a local optimization needs at least 1 held view of a marker"},
  });
}

int Subproblem::markerIndex(int id) const {
  const auto found = std::ranges::lower_bound(markers, id, {}, &Marker::id);
  if (found == markers.end() || found->id != id) return -1;
  return static_cast<int>(found - markers.begin());
}

SubproblemMembers wholeMap(const Map& map) {
  SubproblemMembers roles;
  roles.keyframes.reserve(map.keyframes().size());
  for (const auto& [id, keyframe] : map.keyframes()) roles.keyframes.push_back({id, false});
  for (const auto& [id, marker] : map.markers()) roles.markers.push_back(id);
  return roles;
}

SubproblemMembers localMap(const Map& map, KeyframeId keyframe, const LocalMapOptions& options) {
  const std::vector<KeyframeId> near = nearest(map, keyframe, options.max_keyframes);
  SubproblemMembers roles;
  for (const KeyframeId id : near) {
    map.keyframes().at(id).forEachMarker([&](int marker) { roles.markers.push_back(marker); });
  }
  sortUnique(&roles.markers);
  for (const KeyframeId id : near) roles.keyframes.push_back({id, false});
  for (const KeyframeId id : holders(map, roles.markers, near, options.held_views)) {
    roles.keyframes.push_back({id, true});
  }
  std::ranges::sort(roles.keyframes, {}, &SubproblemMembers::Role::keyframe);
  return roles;
}

Task<SubproblemMembers> regionAround(const Map& map, std::vector<KeyframeId> seeds, int keyframes,
                                     Budget* budget) {
  std::vector<KeyframeId> inside = std::move(seeds);  // as they were come to
  sortUnique(&inside);
  std::set<KeyframeId> known(inside.begin(), inside.end());  // and those that are held
  std::set<int> markers;
  for (std::size_t i = 0; i < inside.size(); ++i) {
    std::vector<KeyframeId> views;
    const auto keyframe = map.keyframes().find(inside[i]);
    if (keyframe == map.keyframes().end()) continue;  // has been let go since the first slice
    keyframe->second.forEachMarker([&](int id) {
      if (markers.insert(id).second) addViews(map, id, &views);
    });
    co_await budget->spend(kFindKeyframe + kFindView * static_cast<double>(views.size()));
    for (const KeyframeId view : views) {
      if (!known.insert(view).second) continue;
      if (static_cast<int>(inside.size()) < keyframes) inside.push_back(view);
    }
  }
  std::ranges::sort(inside);
  SubproblemMembers roles;
  roles.markers.assign(markers.begin(), markers.end());
  for (const KeyframeId id : known) {
    co_await budget->spend(kFindView);
    roles.keyframes.push_back({id, !std::ranges::binary_search(inside, id)});
  }
  co_return roles;
}

SubproblemMembers newestMap(const Map& map, int keyframes) {
  SubproblemMembers roles;
  std::vector<KeyframeId> ids;
  for (auto it = map.keyframes().rbegin(); it != map.keyframes().rend(); ++it) {
    if (static_cast<int>(ids.size()) == keyframes) break;
    ids.push_back(it->first);
  }
  std::ranges::reverse(ids);
  for (const KeyframeId id : ids) roles.keyframes.push_back({id, id == ids.front()});
  roles.markers = map.markersSeenFrom(ids);
  return roles;
}

Task<Subproblem> buildSubproblem(const Map& map, SubproblemMembers roles,
                                 const MarkerOptions& markers, Budget* budget) {
  Subproblem part;
  part.epoch = map.epoch();
  (void)co_await addMarkers(map, roles.markers, markers, &part, budget);
  (void)co_await addKeyframes(map, roles.keyframes, markers, &part, budget);
  for (std::size_t c = 0; c < part.keyframes.size(); ++c) {
    const auto found = map.keyframes().find(part.keyframes[c]);
    if (found == map.keyframes().end()) continue;  // has been let go since the first slice
    const SharedDetections& views = part.detections.emplace_back(found->second.detections);
    for (const MarkerDetection& detection : views) {
      const int marker = part.markerIndex(detection.id);
      if (marker < 0) continue;
      part.problem.observations.push_back({static_cast<int>(c), marker, &detection});
    }
    addLinks(found->second, static_cast<int>(c), &part);
    co_await budget->spend(kTakeView *
                           static_cast<double>(views.size() + found->second.links.size()));
  }
  if (!markers.constraints.empty()) {
    (void)co_await addConstraints(map, markers, &part, budget);
  }
  co_return part;
}

Task<MapCorrection> correctionOf(const Subproblem& part, const BundleAdjuster& adjuster,
                                 Budget* budget) {
  MapCorrection correction;
  correction.summary = adjuster.summary();
  correction.epoch = part.epoch;
  correction.keyframes.reserve(part.keyframes.size());
  for (std::size_t c = 0; c < part.keyframes.size(); ++c) {
    co_await budget->spend(kTakePose);
    correction.keyframes.push_back({part.keyframes[c], adjuster.problem().cameras[c].T});
  }
  correction.markers.reserve(part.markers.size());
  for (std::size_t m = 0; m < part.markers.size(); ++m) {
    co_await budget->spend(kTakeCovariance);
    correction.markers.push_back({part.markers[m], adjuster.problem().markers[m].T,
                                  adjuster.markerCovariance(static_cast<int>(m))});
  }
  for (const std::size_t view : adjuster.gatedViews()) {
    const auto& observation = adjuster.problem().observations[view];
    const auto camera = static_cast<std::size_t>(observation.camera);
    if (camera >= part.keyframes.size()) continue;  // not of the map
    correction.outliers.push_back({part.keyframes[camera], observation.detection->id});
  }
  co_return correction;
}

const MapMarker* findUnmoved(const Map& map, const Subproblem::Marker& marker) {
  const MapMarker* const known = map.findPosed(marker.id);
  return known != nullptr && known->former_poses.size() == marker.former_poses ? known : nullptr;
}

bool apply(const MapCorrection& correction, Map* map) {
  if (correction.epoch != map->epoch()) return false;
  map->setKeyframePoses(correction.keyframes);
  for (const auto& corrected : correction.markers) {
    const MapMarker* const known = findUnmoved(*map, corrected.marker);
    if (known == nullptr) continue;
    map->place(known->id, corrected.T_w_m, known->other_T_w_m, corrected.covariance);
  }
  return true;
}

void removeOutliers(const MapCorrection& correction, Map* map) {
  for (const auto& [keyframe, marker] : correction.outliers) {
    map->removeViews(marker, {&keyframe, 1});
  }
}

namespace {

// Of a keyframe's markers, the one whose place is known best; null where it sees none with a place.
const MapMarker* bestKnownMarker(const Keyframe& keyframe, const Map& map) {
  const MapMarker* best = nullptr;
  const auto variance = [](const MapMarker& marker) {
    return marker.covariance.topLeftCorner<3, 3>().trace();
  };
  for (const MarkerDetection& detection : keyframe.detections) {
    const MapMarker* const marker = map.findPosed(detection.id);
    if (marker != nullptr && (best == nullptr || variance(*marker) < variance(*best))) {
      best = marker;
    }
  }
  return best;
}

}  // namespace

Transform motionAround(KeyframeId keyframe, const MapCorrection& correction, const Map& map) {
  const auto found = map.keyframes().find(keyframe);
  if (found == map.keyframes().end()) return {};
  // A camera that was carried to where it is moves to where its markers want it: the world around
  // it is where these are. How a marker is turned is known too badly to turn a world by.
  const bool carried = !found->second.links.empty();
  if (const MapMarker* const marker = carried ? bestKnownMarker(found->second, map) : nullptr) {
    Transform T_new_old;
    for (const auto& corrected : correction.markers) {
      if (findUnmoved(map, corrected.marker) == marker) {
        T_new_old.p = corrected.T_w_m.p - marker->T_w_m->p;
      }
    }
    return T_new_old;
  }
  const auto corrected =
      std::ranges::lower_bound(correction.keyframes, keyframe, {}, &KeyframePose::id);
  const bool is_in_it = corrected != correction.keyframes.end() && corrected->id == keyframe;
  return is_in_it ? corrected->T_w_c * found->second.T_w_c.inverse() : Transform{};
}

std::optional<Transform> applyAround(KeyframeId keyframe, const MapCorrection& correction,
                                     Map* map) {
  const Transform T_new_old = motionAround(keyframe, correction, *map);
  return apply(correction, map) ? std::optional(T_new_old) : std::nullopt;
}

}  // namespace waymark::slam
