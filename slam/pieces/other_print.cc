#include "slam/pieces/other_print.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <vector>

#include "slam/geometry/polygon.h"

namespace waymark::slam {
namespace {

Eigen::Vector2d centreOf(const std::array<Eigen::Vector2d, 4>& corners) {
  return 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
}

// Where a camera there would see a marker of the map; empty where not wholly, well inside the image
// and from the front.
std::optional<std::array<Eigen::Vector2d, 4>> expectedCorners(const MapMarker& marker,
                                                              const Transform& T_w_c,
                                                              const JointParts& parts) {
  const CameraModel& camera = parts.camera;
  const PieceOptions::OtherPrint& options = parts.options.other_print;
  const Eigen::Vector3d to_camera = (T_w_c.p - marker.T_w_m->p).normalized();
  if (marker.T_w_m->R.col(2).dot(to_camera) < std::cos(options.max_slant_rad)) return std::nullopt;
  const Transform T_c_w = T_w_c.inverse();
  std::array<Eigen::Vector2d, 4> corners;
  const std::array<Eigen::Vector3d, 4> corners_w = marker.cornersInWorld();
  for (std::size_t k = 0; k < 4; ++k) {
    const auto pixel = camera.project(T_c_w * corners_w[k]);
    if (!pixel || !camera.inImage(*pixel, options.border_share * camera.width())) {
      return std::nullopt;
    }
    corners[k] = *pixel;
  }
  return corners;
}

// The other markers that were seen from about there.
std::set<int> seenFromThere(const Map& map, const MapMarker& marker, const Transform& T_w_c,
                            const PieceOptions::OtherPrint& options) {
  const Eigen::Vector3d now = T_w_c.p - marker.T_w_m->p;
  std::set<int> others;
  for (const KeyframeId id : map.viewsOf(marker.id)) {
    const Keyframe& keyframe = map.keyframes().at(id);
    const Eigen::Vector3d then = keyframe.T_w_c.p - marker.T_w_m->p;
    const double ratio = now.norm() / then.norm();
    const double cosine = now.dot(then) / (now.norm() * then.norm());
    if (ratio > options.max_distance_ratio || ratio < 1.0 / options.max_distance_ratio ||
        cosine < std::cos(options.max_angle_rad)) {
      continue;
    }
    for (const MarkerDetection& detection : keyframe.detections) {
      if (detection.id != marker.id && map.findPosed(detection.id) != nullptr) {
        others.insert(detection.id);
      }
    }
  }
  return others;
}

bool surroundingsAreMissing(const MapMarker& marker, const Transform& T_w_c, const Map& map,
                            double least_side_px, std::span<const MarkerDetection> detections,
                            const JointParts& parts) {
  int missing = 0;
  bool replaced = false;
  for (const int id : seenFromThere(map, marker, T_w_c, parts.options.other_print)) {
    const auto expected = expectedCorners(*map.findPosed(id), T_w_c, parts);
    if (!expected || meanSide(*expected) < least_side_px) continue;
    ++missing;
    replaced =
        replaced || std::ranges::any_of(detections, [&](const MarkerDetection& other) {
          return (centreOf(other.pixels) - centreOf(*expected)).norm() < 0.5 * meanSide(*expected);
        });
  }
  return missing >= parts.options.other_print.missing || replaced;
}

}  // namespace

bool isAnotherPrint(const Map& map, std::span<const MarkerDetection> detections,
                    const JointParts& parts) {
  const MarkerDetection* only = nullptr;
  for (const MarkerDetection& detection : detections) {
    if (map.findPosed(detection.id) == nullptr) continue;
    if (only != nullptr) return false;
    only = &detection;
  }
  if (only == nullptr || map.viewsOf(only->id).empty()) return false;
  const MapMarker& marker = *map.findPosed(only->id);
  const auto square =
      estimateSquarePose(*only, marker.size_m, parts.camera.focalLength(), parts.square);
  if (!square) return false;
  const double least_side_px = parts.options.other_print.least_side * meanSide(only->pixels);
  // From either of its poses, where it does not say which.
  const bool both = !square->unambiguous(parts.options.ambiguity_ratio);
  for (std::size_t i = 0; i < (both ? 2U : 1U); ++i) {
    const Transform T_w_c = *marker.T_w_m * square->T_c_m[i].inverse();
    if (!surroundingsAreMissing(marker, T_w_c, map, least_side_px, detections, parts)) return false;
  }
  return true;
}

}  // namespace waymark::slam
