#include "slam/keyframes/keyframe_policy.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace waymark::slam {
namespace {

// Eq. 28: indices (into `views`) of the `count` views that lie farthest from each other: the two
// most separated first, then always the one farthest from those chosen.
std::vector<std::size_t> farthestViews(const std::vector<Eigen::Vector3d>& views,
                                       std::size_t count) {
  std::vector<std::size_t> chosen;
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
  chosen = {first, second};
  std::vector<double> nearest(views.size());  // squared distance to the nearest chosen view
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

}  // namespace

double viewDistance(const Transform& a, const Transform& b, double depth_m,
                    const KeyframeOptions& options) {
  const double baseline =
      std::max(options.min_baseline_m, options.min_baseline_per_depth * depth_m);
  return (a.p - b.p).norm() / baseline + rotationDistance(a.R, b.R) / options.min_rotation_rad;
}

std::size_t referenceKeyframe(const Map& map, const Transform& T_w_c, double depth_m,
                              const KeyframeOptions& options) {
  std::size_t best = 0;
  double nearest = std::numeric_limits<double>::max();
  for (std::size_t i = 0; i < map.keyframes.size(); ++i) {
    const double d = viewDistance(map.keyframes[i].T_w_c, T_w_c, depth_m, options);
    if (d < nearest) {
      nearest = d;
      best = i;
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
  const Keyframe& reference = map.keyframes[referenceKeyframe(map, T_w_c, depth_m, options)];
  if (viewDistance(reference.T_w_c, T_w_c, depth_m, options) > 1.0) {
    return KeyframeReason::kBaseline;
  }
  return KeyframeReason::kNone;
}

int cullKeyframes(Map* map, const KeyframeOptions& options) {
  std::vector<bool> keep(map->keyframes.size(), false);
  keep[0] = true;
  for (const auto& [id, marker] : map->markers) {
    std::vector<std::size_t> seen_in;
    std::vector<Eigen::Vector3d> views;
    for (std::size_t i = 0; i < map->keyframes.size(); ++i) {
      if (map->keyframes[i].find(id) == nullptr) continue;
      seen_in.push_back(i);
      views.push_back(map->keyframes[i].T_w_c.p);
    }
    const auto count = static_cast<std::size_t>(options.views_per_marker);
    for (const std::size_t chosen : farthestViews(views, count)) keep[seen_in[chosen]] = true;
  }
  std::size_t i = 0;
  return static_cast<int>(
      std::erase_if(map->keyframes, [&](const Keyframe&) { return !keep[i++]; }));
}

}  // namespace waymark::slam
