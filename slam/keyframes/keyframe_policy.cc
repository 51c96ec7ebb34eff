#include "slam/keyframes/keyframe_policy.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <memory_resource>
#include <set>
#include <vector>

#include "base/stack_arena.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

using Positions = std::pmr::vector<Eigen::Vector3d>;
using Arena = StackArena<8192>;  // for as many views as a marker usually has

// Eq. 28: indices (into `views`) of the `count` views that lie farthest from each other: the two
// most separated first, then always the one farthest from those chosen.
std::pmr::vector<std::size_t> farthestViews(const Positions& views, std::size_t count,
                                            Arena* arena) {
  std::pmr::vector<std::size_t> chosen(arena->get());
  if (views.size() <= count) {
    for (std::size_t i = 0; i < views.size(); ++i) chosen.push_back(i);
    return chosen;
  }
  std::size_t first = 0;
  std::size_t second = 1;
  double widest = -1.0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    for (std::size_t j = i + 1; j < views.size(); ++j) {
      const double d = (views[i] - views[j]).squaredNorm();
      if (d > widest) {
        widest = d;
        first = i;
        second = j;
      }
    }
  }
  chosen.assign({first, second});
  std::pmr::vector<double> nearest(views.size(), 0.0,
                                   arena->get());  // squared distance to the nearest chosen view
  for (std::size_t i = 0; i < views.size(); ++i)
    nearest[i] = (views[i] - views[first]).squaredNorm();
  while (chosen.size() < count) {
    for (std::size_t i = 0; i < views.size(); ++i) {
      nearest[i] = std::min(nearest[i], (views[i] - views[chosen.back()]).squaredNorm());
    }
    chosen.push_back(static_cast<std::size_t>(std::max_element(nearest.begin(), nearest.end()) -
                                              nearest.begin()));
  }
  return chosen;
}

Positions positionsOf(const Map& map, std::span<const KeyframeId> keyframes, Arena* arena) {
  Positions positions(arena->get());
  positions.reserve(keyframes.size() + 1);
  for (const KeyframeId id : keyframes) positions.push_back(map.keyframes().at(id).T_w_c.p);
  return positions;
}

// Whether a marker of the frame would choose it among its N_c views.
bool wouldBeKept(const Map& map, std::span<const MarkerDetection> detections,
                 const Transform& T_w_c, const KeyframeOptions& options) {
  const auto count = static_cast<std::size_t>(options.views_per_marker);
  return std::any_of(detections.begin(), detections.end(), [&](const MarkerDetection& detection) {
    Arena arena;
    Positions views = positionsOf(map, map.viewsOf(detection.id), &arena);
    if (views.size() < count) return true;
    views.push_back(T_w_c.p);
    const auto chosen = farthestViews(views, count, &arena);
    return std::find(chosen.begin(), chosen.end(), views.size() - 1) != chosen.end();
  });
}

// Rule 2b for these detections: far from every keyframe that sees one of them, and of use to one.
bool widensBaseline(const Map& map, std::span<const MarkerDetection> detections,
                    const Transform& T_w_c, double depth_m, const KeyframeOptions& options) {
  const auto reference = referenceKeyframe(map, detections, T_w_c, depth_m, options);
  if (!reference) return true;
  const Transform& nearest = map.keyframes().at(*reference).T_w_c;
  return viewDistance(nearest, T_w_c, depth_m, options) > 1.0 &&
         wouldBeKept(map, detections, T_w_c, options);
}

}  // namespace

std::string KeyframeOptions::invalidReason() const {
  return firstUnmet({
      {isPositive(min_baseline_m) && isPositive(min_rotation_rad),
       "keyframe distances must be positive"},
      {isNotNegative(min_baseline_per_depth), "keyframe distances must not be negative"},
      {views_per_marker >= 2, "views per marker must be at least 2"},
      {isPositive(unknown_depth_m), "the distance of unknown markers must be positive"},
  });
}

double viewDistance(const Transform& a, const Transform& b, double depth_m,
                    const KeyframeOptions& options) {
  const double baseline =
      std::max(options.min_baseline_m, options.min_baseline_per_depth * depth_m);
  return (a.p - b.p).norm() / baseline + rotationDistance(a.R, b.R) / options.min_rotation_rad;
}

std::optional<KeyframeId> referenceKeyframe(const Map& map,
                                            std::span<const MarkerDetection> detections,
                                            const Transform& T_w_c, double depth_m,
                                            const KeyframeOptions& options) {
  std::optional<KeyframeId> best;
  double nearest = std::numeric_limits<double>::max();
  for (const MarkerDetection& detection : detections) {
    for (const KeyframeId id : map.viewsOf(detection.id)) {
      const double d = viewDistance(map.keyframes().at(id).T_w_c, T_w_c, depth_m, options);
      if (d < nearest || (d == nearest && id < *best)) {
        nearest = d;
        best = id;
      }
    }
  }
  return best;
}

KeyframeReason keyframeReason(const Map& map, std::span<const MarkerDetection> detections,
                              const Transform& T_w_c, double depth_m, bool resolved,
                              const KeyframeOptions& options) {
  const bool has_new =
      std::any_of(detections.begin(), detections.end(),
                  [&](const MarkerDetection& d) { return map.find(d.id) == nullptr; });
  if (has_new) return KeyframeReason::kNewMarker;
  if (resolved) return KeyframeReason::kMarkerResolved;
  if (widensBaseline(map, detections, T_w_c, depth_m, options)) return KeyframeReason::kBaseline;
  // A marker without a pose needs views of its own, also where keyframes that do not see it (from
  // before it moved) are dense already.
  for (const MarkerDetection& detection : detections) {
    if (map.findPosed(detection.id) == nullptr &&
        widensBaseline(map, {&detection, 1}, T_w_c, depth_m, options)) {
      return KeyframeReason::kBaseline;
    }
  }
  return KeyframeReason::kNone;
}

int cullKeyframes(Map* map, KeyframeId newest, const KeyframeOptions& options) {
  const std::vector<KeyframeId> near = map->neighbours(newest);
  std::set<KeyframeId> chosen = {newest, map->keyframes().begin()->first};
  const auto count = static_cast<std::size_t>(options.views_per_marker);
  for (const int id : map->markersSeenFrom(near)) {
    const auto views = map->viewsOf(id);
    Arena arena;
    for (const std::size_t i : farthestViews(positionsOf(*map, views, &arena), count, &arena)) {
      chosen.insert(views[i]);
    }
  }
  int removed = 0;
  for (const KeyframeId id : near) {
    // What is linked to one may hang on nothing else.
    if (chosen.count(id) != 0 || !map->keyframes().at(id).links.empty()) continue;
    map->removeKeyframe(id);
    ++removed;
  }
  return removed;
}

}  // namespace waymark::slam
