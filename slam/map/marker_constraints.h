// What surveyors and floor plans know of the markers, beyond the poses of single ones (Anchor).
// Each is a residual in the optimizations, robust and gated: what the views contradict is left out,
// and told (covariance/constraint_check.h).
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "slam/geometry/transform.h"

namespace waymark::slam {

struct IdRange {
  int first = 0;
  int last = 0;  // inclusive

  [[nodiscard]] bool contains(int id) const { return first <= id && id <= last; }
};

// A marker whose centre somebody surveyed, but not how it is turned. Three that are not in a line
// fix the world, as one anchor does.
struct SurveyedPosition {
  int id = -1;
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();  // metres, in the world of the anchors
  double sigma_m = 0.002;  // of each coordinate: a total station, and the centre found by eye
};

// How a plane lies to the vertical: faces up, faces down, is upright, or nobody knows.
enum class PlaneKind { kAny, kFloor, kCeiling, kWall };

// Markers that hang on one plane, which is unknown. All face the same side.
struct MarkerPlane {
  std::string name{};          // for people
  std::vector<IdRange> ids{};  // those that are never seen do no harm
  PlaneKind kind = PlaneKind::kAny;
  double sigma_m = 0.003;   // of a centre, out of the plane: plaster and paper
  double sigma_rad = 0.01;  // of a face, about each axis in the plane; and of a floor's, a
                            // ceiling's or a wall's whole plane against the vertical
};

// Markers that hang upright: their y axis is the vertical, which they share.
struct UprightMarkers {
  std::vector<IdRange> ids{};
  double sigma_rad = 0.02;  // about each axis: hung by eye
};

// Between two corners of two markers, along a tape. Corners as in Corners::pixels: 0 to 3 from the
// top left, clockwise.
struct CornerDistance {
  int id_a = -1;
  int corner_a = 0;
  int id_b = -1;
  int corner_b = 0;
  double distance_m = 0.0;
  double sigma_m = 0.003;  // a tape, and somebody's eye at both ends
};

struct MarkerConstraints {
  std::vector<SurveyedPosition> positions{};
  std::vector<MarkerPlane> planes{};
  UprightMarkers upright{};
  std::vector<CornerDistance> distances{};
  // The vertical in the world, upwards, of any length; for a world whose anchors, positions or
  // origin marker were surveyed so. Without it, it is unknown, and what is upright or level shares
  // it.
  std::optional<Eigen::Vector3d> up_w{};
  // What is farther from what all else says than so many standard deviations is contradicted. Of
  // hundreds of sound ones none is; smaller finds small mistakes, and sound ones whose sigma was
  // said too small.
  double gate_sigmas = 5.0;

  [[nodiscard]] bool empty() const {
    return positions.empty() && planes.empty() && upright.ids.empty() && distances.empty();
  }
  // Empty when usable, else which is wrong and why.
  [[nodiscard]] std::string invalidReason() const;
  // Of the ids that are named one by one or are the first or last of a range, the first that `is`
  // says so of, and in what: "plane \"north\": 12"; empty where there is none.
  [[nodiscard]] std::string findId(const std::function<bool(int)>& is) const;
};

// Of a plane, for people: its name, or its number among the planes.
[[nodiscard]] std::string planeName(const MarkerConstraints& constraints, std::size_t plane);
[[nodiscard]] std::string distanceName(const CornerDistance& distance);

}  // namespace waymark::slam
