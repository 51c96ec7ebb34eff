// Scenes for the tests of the map's stages: a room, the views of somebody who turns round in it,
// and the map that somebody perfect would have made of them.
#pragma once

#include <cmath>
#include <numbers>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "slam/map/map.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam::testing {

inline constexpr std::int64_t kFramePeriodNs = 16'666'667;

// A transform a random step away: each coordinate by sigma, metres and radians.
inline Transform disturbed(const Transform& T, double sigma, std::mt19937* rng) {
  std::normal_distribution<double> noise(0.0, sigma);
  Vector6d delta;
  for (int i = 0; i < 6; ++i) delta[i] = noise(*rng);
  return T.retract(delta);
}

// Moves what a keyframe saw of a marker to the right, in normalized coordinates.
inline void displaceView(KeyframeId keyframe, int marker, double right, Map* map) {
  MarkerDetection elsewhere = *map->keyframes().at(keyframe).find(marker);
  for (auto& corner : elsewhere.normalized) corner.x() += right;
  map->removeViews(marker, {&keyframe, 1});
  map->addView(keyframe, elsewhere);
}

// `count` markers all round a room, on a cylinder of the given radius about the world's z axis,
// each turned a little away from the middle and a little up or down; ids counter-clockwise from the
// x axis.
inline std::vector<SyntheticMarker> roomMarkers(int count, double radius_m, std::mt19937* rng) {
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  std::vector<SyntheticMarker> markers;
  for (int i = 0; i < count; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / count;
    const Eigen::Vector3d centre(radius_m * std::cos(angle), radius_m * std::sin(angle),
                                 0.3 * u(*rng));
    const Eigen::Vector3d towards(0.4 * radius_m * u(*rng), 0.4 * radius_m * u(*rng),
                                  0.8 * u(*rng));
    markers.push_back({i, markerFacing(centre, towards)});
  }
  return markers;
}

// Six markers some 3 m from the origin that nearly face it. With a side of 10 cm they are 17 pixels
// wide, and every single view of them is ambiguous.
inline std::vector<SyntheticMarker> frontalMarkers(std::mt19937* rng) {
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  std::vector<SyntheticMarker> markers;
  for (int i = 0; i < 6; ++i) {
    const int column = i % 3;
    const int row = i / 3;
    const Eigen::Vector3d centre(0.4 * (column - 1), 3.0 + 0.1 * u(*rng), 0.4 * row - 0.2);
    const Eigen::Vector3d towards = centre + Eigen::Vector3d(0.25 * u(*rng), -1, 0.25 * u(*rng));
    markers.push_back({i, markerFacing(centre, towards)});
  }
  return markers;
}

// A camera that turns round in the room and looks outwards, a little off the middle.
inline Transform roomView(double angle_rad, double off_middle_m = 0.5) {
  const Eigen::Vector3d outwards(std::cos(angle_rad), std::sin(angle_rad), 0.0);
  const Eigen::Vector3d eye =
      off_middle_m * outwards + Eigen::Vector3d(0.0, 0.0, 0.1 * std::sin(3.0 * angle_rad));
  return lookAt(eye, eye + 2.0 * outwards + Eigen::Vector3d(0.0, 0.0, -0.05));
}

inline std::vector<Transform> roomViews(double from_rad, double to_rad, int count) {
  std::vector<Transform> views;
  for (int i = 0; i < count; ++i) {
    views.push_back(roomView(from_rad + (to_rad - from_rad) * i / (count - 1)));
  }
  return views;
}

// True poses, and what the keyframes see of the markers with noise of sigma_px. Markers that nobody
// sees are not in it.
inline Map trueMap(const CameraModel& camera, std::span<const Transform> views,
                   const std::vector<SyntheticMarker>& markers, double size_m, double sigma_px,
                   std::mt19937* rng) {
  Map map;
  for (const Transform& T_w_c : views) {
    Keyframe keyframe;
    keyframe.T_w_c = T_w_c;
    keyframe.detections = observeAll(camera, T_w_c, markers, size_m, sigma_px, rng);
    for (const SyntheticMarker& marker : markers) {
      if (keyframe.find(marker.id) == nullptr) continue;
      map.addMarker(marker.id, size_m);
      map.place(marker.id, marker.T_w_m);
    }
    (void)map.addKeyframe(std::move(keyframe));
  }
  return map;
}

// Bends a map progressively along the keyframes, by `whole_bend` at the last one; the first one
// stays. That is how it looks before a loop is closed.
inline void bend(const Vector6d& whole_bend, Map* map) {
  const double last = static_cast<double>(map->keyframes().rbegin()->first);
  const auto bendAt = [&](double share) { return Transform{}.retract(share * whole_bend); };
  for (const auto& [id, marker] : map->markers()) {
    double share = 0.0;
    const auto seen_by = map->viewsOf(id);
    for (const KeyframeId view : seen_by) {
      share += static_cast<double>(view) / last / static_cast<double>(seen_by.size());
    }
    map->place(id, bendAt(share) * *marker.T_w_m, marker.other_T_w_m, marker.covariance);
  }
  for (const auto& [id, keyframe] : map->keyframes()) {
    map->setKeyframePose(id, bendAt(static_cast<double>(id) / last) * keyframe.T_w_c);
  }
}

}  // namespace waymark::slam::testing
