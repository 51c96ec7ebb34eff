#include "slam/detection/edges/marker_side.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <Eigen/LU>

#include "slam/geometry/homography.h"
#include "slam/geometry/plane.h"

namespace waymark::slam {
namespace {

// The quartic through a curve's points at t = 0, 1/4, 1/2, 3/4, 1: coefficients of t^k.
std::array<Eigen::Vector2d, 5> quarticThrough(const std::array<Eigen::Vector2d, 5>& p) {
  return {p[0], 4.0 / 12.0 * (-25.0 * p[0] + 48.0 * p[1] - 36.0 * p[2] + 16.0 * p[3] - 3.0 * p[4]),
          16.0 / 24.0 * (35.0 * p[0] - 104.0 * p[1] + 114.0 * p[2] - 56.0 * p[3] + 11.0 * p[4]),
          64.0 / 12.0 * (-5.0 * p[0] + 18.0 * p[1] - 24.0 * p[2] + 14.0 * p[3] - 3.0 * p[4]),
          256.0 / 24.0 * (p[0] - 4.0 * p[1] + 6.0 * p[2] - 4.0 * p[3] + p[4])};
}

// False for a side without length.
bool layOutLine(const CameraModel& camera, const Eigen::Vector2d& start, const Eigen::Vector2d& end,
                MarkerSide* side) {
  side->start = start;
  side->end = end;
  side->length = (end - start).norm();
  if (!(side->length > 0.0)) return false;
  side->along = (end - start) / side->length;
  side->outward = {side->along.y(), -side->along.x()};

  Eigen::Matrix2d J_start;
  Eigen::Matrix2d J_end;
  side->start_px = camera.distort(start, &J_start);
  side->end_px = camera.distort(end, &J_end);
  side->length_px = (side->end_px - side->start_px).norm();
  const auto between = [&](double t) { return camera.distort(start + t * (end - start)); };
  side->curve_px =
      quarticThrough({side->start_px, between(0.25), between(0.5), between(0.75), side->end_px});
  // A line moved by d in normalized units moves by d / |J^-T outward| pixels across itself.
  side->scale_start = 1.0 / (J_start.inverse().transpose() * side->outward).norm();
  side->scale_end = 1.0 / (J_end.inverse().transpose() * side->outward).norm();
  return true;
}

// The border's thickness and the perspective along the side from a to b of the unit square, seen
// through H. False when the inner line of the border is out of order.
bool layOutPrint(const Eigen::Matrix3d& H, const Eigen::Vector2d& a, const Eigen::Vector2d& b,
                 MarkerSide* side) {
  const double border = 1.0 / side->cells;
  const Eigen::Vector2d inward(-(b - a).y(), (b - a).x());
  const Eigen::Vector2d inner_a =
      applyHomography(H, a + border * (b - a) + border * inward) - side->start;
  const Eigen::Vector2d inner_b =
      applyHomography(H, b - border * (b - a) + border * inward) - side->start;
  const double t_a = inner_a.dot(side->along) / side->length;
  const double t_b = inner_b.dot(side->along) / side->length;
  if (!(t_b > t_a)) return false;
  // The inner line's distance from the side at its two ends, continued to the side's ends.
  const double depth_a = -inner_a.dot(side->outward);
  const double slope = (-inner_b.dot(side->outward) - depth_a) / (t_b - t_a);
  side->thickness_start = (depth_a - slope * t_a) * side->scale_start;
  side->thickness_end = (depth_a + slope * (1.0 - t_a)) * side->scale_end;

  // Where the print's middle of this side falls gives the perspective along it.
  const Eigen::Vector2d middle = applyHomography(H, 0.5 * (a + b)) - side->start;
  const double t_middle = std::clamp(middle.dot(side->along) / side->length, 0.05, 0.95);
  side->perspective = t_middle / (1.0 - t_middle);
  return side->thickness_start > 0.0 && side->thickness_end > 0.0;
}

}  // namespace

void MarkerSide::placeIn(const PlacedImage& placed) {
  start_px = placed.fromCamera(start_px);
  end_px = placed.fromCamera(end_px);
  curve_px[0] = placed.fromCamera(curve_px[0]);
  for (std::size_t k = 1; k < curve_px.size(); ++k) curve_px[k] /= placed.factor;
  for (double* const scaled :
       {&length_px, &scale_start, &scale_end, &thickness_start, &thickness_end}) {
    *scaled /= placed.factor;
  }
}

void MarkerSide::bend(double bow_px) {
  const Eigen::Vector2d along_px = (end_px - start_px).normalized();
  const Eigen::Vector2d outward_px(along_px.y(), -along_px.x());
  curve_px[1] += 4.0 * bow_px * outward_px;  // 4 t (1 - t) of it
  curve_px[2] -= 4.0 * bow_px * outward_px;
}

std::optional<std::array<MarkerSide, 4>> layOutSides(const CameraModel& camera,
                                                     const std::array<Eigen::Vector2d, 4>& corners,
                                                     int cells) {
  const auto H = homographyFromUnitSquare(corners);
  if (!H) return std::nullopt;
  const std::array<Eigen::Vector2d, 4> unit = {Eigen::Vector2d(0, 0), Eigen::Vector2d(1, 0),
                                               Eigen::Vector2d(1, 1), Eigen::Vector2d(0, 1)};
  std::array<MarkerSide, 4> sides;
  for (std::size_t k = 0; k < 4; ++k) {
    const std::size_t next = (k + 1) % 4;
    sides[k].cells = cells;
    if (!layOutLine(camera, corners[k], corners[next], &sides[k])) return std::nullopt;
    if (!layOutPrint(*H, unit[k], unit[next], &sides[k])) return std::nullopt;
  }
  for (std::size_t k = 0; k < 4; ++k) {
    MarkerSide& side = sides[k];
    side.sine_start = std::abs(cross(side.along, sides[(k + 3) % 4].along));
    side.sine_end = std::abs(cross(side.along, sides[(k + 1) % 4].along));
  }
  return sides;
}

}  // namespace waymark::slam
