#include "slam/optimisation/map_optimiser.h"

#include <algorithm>
#include <map>
#include <set>
#include <vector>

namespace waymark::slam {
namespace {

enum class Role { kLeftOut, kFixed, kFree };

bool sharesMarker(const Keyframe& a, const Keyframe& b) {
  return std::any_of(a.detections.begin(), a.detections.end(),
                     [&](const MarkerDetection& d) { return b.find(d.id) != nullptr; });
}

// Builds the problem from the keyframes' roles and the markers' ids, solves it and writes the poses
// back.
BundleSummary optimise(Map* map, const std::vector<Role>& roles, const std::set<int>& marker_ids,
                       const BundleOptions& options) {
  BundleProblem problem;
  std::map<int, int> marker_index;
  for (const int id : marker_ids) {
    const MapMarker& marker = map->markers.at(id);
    marker_index[id] = static_cast<int>(problem.markers.size());
    problem.markers.push_back({*marker.T_w_m, false});
    problem.marker_sizes_m.push_back(marker.size_m);
  }
  std::vector<std::size_t> camera_keyframe;
  for (std::size_t i = 0; i < map->keyframes.size(); ++i) {
    if (roles[i] == Role::kLeftOut) continue;
    const Keyframe& keyframe = map->keyframes[i];
    const int camera = static_cast<int>(problem.cameras.size());
    bool used = false;
    for (const MarkerDetection& detection : keyframe.detections) {
      const auto found = marker_index.find(detection.id);
      if (found == marker_index.end()) continue;
      problem.observations.push_back({camera, found->second, &detection});
      used = true;
    }
    if (!used) continue;
    problem.cameras.push_back({keyframe.T_w_c, roles[i] == Role::kFixed});
    camera_keyframe.push_back(i);
  }
  const BundleSummary summary = adjustBundle(&problem, options);
  for (std::size_t c = 0; c < problem.cameras.size(); ++c) {
    map->keyframes[camera_keyframe[c]].T_w_c = problem.cameras[c].T;
  }
  for (const auto& [id, index] : marker_index) {
    map->markers.at(id).T_w_m = problem.markers[static_cast<std::size_t>(index)].T;
  }
  return summary;
}

}  // namespace

BundleSummary optimiseLocally(Map* map, std::size_t keyframe, const BundleOptions& options) {
  const Keyframe& newest = map->keyframes[keyframe];
  std::vector<Role> roles(map->keyframes.size(), Role::kLeftOut);
  std::set<int> marker_ids;
  for (std::size_t i = 0; i < map->keyframes.size(); ++i) {
    if (!sharesMarker(map->keyframes[i], newest)) continue;
    roles[i] = i == 0 ? Role::kFixed : Role::kFree;
    for (const MarkerDetection& detection : map->keyframes[i].detections) {
      if (map->findPosed(detection.id) != nullptr) marker_ids.insert(detection.id);
    }
  }
  for (std::size_t i = 0; i < map->keyframes.size(); ++i) {
    if (roles[i] != Role::kLeftOut) continue;
    const auto& detections = map->keyframes[i].detections;
    const bool sees_one =
        std::any_of(detections.begin(), detections.end(),
                    [&](const MarkerDetection& d) { return marker_ids.count(d.id) != 0; });
    if (sees_one) roles[i] = Role::kFixed;
  }
  return optimise(map, roles, marker_ids, options);
}

BundleSummary optimiseGlobally(Map* map, const BundleOptions& options) {
  if (map->empty()) return {};
  std::vector<Role> roles(map->keyframes.size(), Role::kFree);
  roles[0] = Role::kFixed;
  std::set<int> marker_ids;
  for (const auto& [id, marker] : map->markers) {
    if (marker.T_w_m) marker_ids.insert(id);
  }
  return optimise(map, roles, marker_ids, options);
}

}  // namespace waymark::slam
