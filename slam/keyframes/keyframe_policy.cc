#include "slam/keyframes/keyframe_policy.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

#include "slam/keyframes/farthest_views.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Whether a marker of the frame would choose it among its N_c views.
bool wouldBeKept(const Map& map, std::span<const MarkerDetection> detections,
                 const Transform& T_w_c, const KeyframeOptions& options) {
  const auto count = static_cast<std::size_t>(options.views_per_marker);
  return std::any_of(detections.begin(), detections.end(), [&](const MarkerDetection& detection) {
    ViewArena arena;
    ViewPositions views = viewPositions(map, map.viewsOf(detection.id), &arena);
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

}  // namespace waymark::slam
