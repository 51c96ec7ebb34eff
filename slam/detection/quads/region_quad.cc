#include "slam/detection/quads/region_quad.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include <Eigen/Geometry>

#include "slam/geometry/plane.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// How far p lies outside of the line from a to b of a clockwise outline, times |b - a|.
double outside(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& p) {
  return -cross(b - a, p - a);
}

// Moments of a line of even density: least-squares lines through pieces of an outline.
struct LineMoments {
  double length = 0.0;
  Eigen::Vector2d first = Eigen::Vector2d::Zero();
  Eigen::Matrix2d second = Eigen::Matrix2d::Zero();

  void add(const Eigen::Vector2d& p, const Eigen::Vector2d& q) {
    const double l = (q - p).norm();
    const Eigen::Vector2d middle = 0.5 * (p + q);
    const Eigen::Vector2d half = 0.5 * (q - p);
    length += l;
    first += l * middle;
    second += l * (middle * middle.transpose() + half * half.transpose() / 3.0);
  }
  // (n, c) with n . p + c = 0 and |n| = 1. Precondition: length > 0.
  [[nodiscard]] Eigen::Vector3d line() const {
    const Eigen::Vector2d mean = first / length;
    const Eigen::Matrix2d scatter = second / length - mean * mean.transpose();
    // The eigenvector of the larger eigenvalue, from the row that does not cancel.
    const double half = 0.5 * (scatter(0, 0) - scatter(1, 1));
    const double root = std::sqrt(half * half + scatter(0, 1) * scatter(0, 1));
    Eigen::Vector2d along = half > 0.0 ? Eigen::Vector2d(half + root, scatter(0, 1))
                                       : Eigen::Vector2d(scatter(0, 1), root - half);
    along.normalize();
    return {-along.y(), along.x(), along.y() * mean.x() - along.x() * mean.y()};
  }
};

}  // namespace

std::string RegionQuadOptions::invalidReason() const {
  return firstUnmet({
      {isPositive(min_side_px), "the shortest side must be positive"},
      {isNotNegative(outline_tolerance) && isNotNegative(outline_tolerance_px),
       "the tolerances of an outline must not be negative"},
      {isShare(min_support), "the supported share of an outline must be from 0 to 1"},
      {isPositive(support_px), "the distance of supporting outlines must be positive"},
      {side_end >= 0.0 && side_end < 0.5, "a side's fit must leave out less than all of it"},
      {isPositive(max_corner_shift_px), "the largest shift of a corner must be positive"},
      {isShare(min_vertex_distance), "the least distance of vertices must be from 0 to 1"},
  });
}

std::optional<Quad> RegionQuadFitter::fit(const DarkRegion& region) {
  traceOutline(region);
  fillNotches();
  const auto vertices = findVertices();
  if (!vertices || !sidesAreStraight(*vertices)) return std::nullopt;
  auto quad = intersectSides(*vertices);
  if (!quad || !isSupported(*quad)) return std::nullopt;
  return quad;
}

// Between two rows the outline passes half-way between their outermost pixels: right for steep
// sides and for flat ones.
void RegionQuadFitter::traceOutline(const DarkRegion& region) {
  traced_.clear();
  const auto& rows = region.rows;
  const auto point = [&](double x, std::size_t row, double below) {
    traced_.emplace_back(x, region.top + static_cast<double>(row) + below);
  };
  point(rows.front().left, 0, -0.5);
  point(rows.front().right, 0, -0.5);
  for (std::size_t y = 0; y + 1 < rows.size(); ++y) {
    point(0.5 * (rows[y].right + rows[y + 1].right) + 0.5, y, 0.5);
  }
  point(rows.back().right, rows.size() - 1, 0.5);
  point(rows.back().left, rows.size() - 1, 0.5);
  for (std::size_t y = rows.size() - 1; y-- > 0;) {
    point(0.5 * (rows[y].left + rows[y + 1].left) - 0.5, y, 0.5);
  }
}

// The convex hull: from the top-left along the right side down and along the left side up, leaving
// out what lies within.
void RegionQuadFitter::fillNotches() {
  outline_.clear();
  for (const Eigen::Vector2d& p : traced_) {
    while (outline_.size() >= 2 &&
           outside(outline_[outline_.size() - 2], p, outline_.back()) <= 0.0) {
      outline_.pop_back();
    }
    outline_.push_back(p);
  }
  // Around the start as well.
  while (outline_.size() > 3 &&
         outside(outline_[outline_.size() - 2], outline_.front(), outline_.back()) <= 0.0) {
    outline_.pop_back();
  }
}

// The point strictly between two of the outline that is farthest outside of their line; how far,
// times the line's length. `from` and 0 when there is none.
RegionQuadFitter::Farthest RegionQuadFitter::farthestBetween(std::size_t from,
                                                             std::size_t to) const {
  Farthest farthest{from, 0.0};
  for (std::size_t i = next(from); i != to; i = next(i)) {
    const double distance = outside(outline_[from], outline_[to], outline_[i]);
    if (distance > farthest.distance) farthest = {i, distance};
  }
  return farthest;
}

std::size_t RegionQuadFitter::farthestFrom(const Eigen::Vector2d& p) const {
  const auto farthest = std::ranges::max_element(
      outline_, {}, [&](const Eigen::Vector2d& q) { return (q - p).squaredNorm(); });
  return static_cast<std::size_t>(farthest - outline_.begin());
}

// Farthest-point insertion, and then each vertex to where it makes the quad largest.
std::optional<RegionQuadFitter::Vertices> RegionQuadFitter::findVertices() const {
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& p : outline_) middle += p / static_cast<double>(outline_.size());
  Vertices found{};
  found[0] = farthestFrom(middle);
  found[1] = farthestFrom(outline_[found[0]]);
  for (std::size_t count = 2; count < found.size(); ++count) {
    Farthest best{0, 0.0};
    std::size_t place = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t after = found[(k + 1) % count];
      Farthest candidate = farthestBetween(found[k], after);
      candidate.distance /= (outline_[after] - outline_[found[k]]).norm() + 1e-9;
      if (candidate.distance <= best.distance) continue;
      best = candidate;
      place = k + 1;
    }
    if (best.distance == 0.0) return std::nullopt;
    std::copy_backward(found.begin() + place, found.begin() + count, found.begin() + count + 1);
    found[place] = best.index;
  }
  constexpr int kRounds = 2;
  for (int round = 0; round < kRounds; ++round) {
    for (std::size_t k = 0; k < 4; ++k) {
      const Farthest better = farthestBetween(found[(k + 3) % 4], found[(k + 1) % 4]);
      if (better.distance > 0.0) found[k] = better.index;
    }
  }
  return found;
}

bool RegionQuadFitter::sidesAreStraight(const Vertices& vertices) const {
  double perimeter = 0.0;
  for (std::size_t k = 0; k < 4; ++k) {
    perimeter += (outline_[vertices[(k + 1) % 4]] - outline_[vertices[k]]).norm();
  }
  const double tolerance =
      std::max(options_.outline_tolerance_px, options_.outline_tolerance * perimeter);
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector2d& a = outline_[vertices[k]];
    const Eigen::Vector2d& b = outline_[vertices[(k + 1) % 4]];
    const double limit = tolerance * (b - a).norm();
    for (std::size_t i = vertices[k]; i != vertices[(k + 1) % 4]; i = next(i)) {
      if (std::abs(outside(a, b, outline_[i])) > limit) return false;
    }
  }
  return true;
}

// A line through the outline between two vertices, without the share at either end that bends
// around the corner.
Eigen::Vector3d RegionQuadFitter::fitSide(std::size_t from, std::size_t to) const {
  const Eigen::Vector2d& start = outline_[from];
  const Eigen::Vector2d chord = outline_[to] - start;
  const double length = chord.norm();
  const Eigen::Vector2d along = chord / length;
  LineMoments moments;
  const auto position = [&](std::size_t i) { return (outline_[i] - start).dot(along) / length; };
  for (std::size_t i = from; i != to; i = next(i)) {
    const double s = position(i);
    const double t = position(next(i));
    const double low = std::max(s, options_.side_end);
    const double high = std::min(t, 1.0 - options_.side_end);
    if (!(high > low)) continue;
    const auto at = [&](double u) -> Eigen::Vector2d {
      return outline_[i] + (u - s) / (t - s) * (outline_[next(i)] - outline_[i]);
    };
    moments.add(at(low), at(high));
  }
  if (moments.length == 0.0) moments.add(start, outline_[to]);
  return moments.line();
}

std::optional<Quad> RegionQuadFitter::intersectSides(const Vertices& vertices) const {
  std::array<Eigen::Vector3d, 4> lines;
  for (std::size_t k = 0; k < 4; ++k) {
    if ((outline_[vertices[(k + 1) % 4]] - outline_[vertices[k]]).norm() <
        options_.min_vertex_distance * options_.min_side_px) {
      return std::nullopt;
    }
    lines[k] = fitSide(vertices[k], vertices[(k + 1) % 4]);
  }
  Quad quad;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d meet = lines[(k + 3) % 4].cross(lines[k]);
    quad[k] = meet.head<2>() / meet.z();
    if (!((quad[k] - outline_[vertices[k]]).norm() < options_.max_corner_shift_px))
      return std::nullopt;
  }
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector2d side = quad[(k + 1) % 4] - quad[k];
    if (side.norm() < options_.min_side_px) return std::nullopt;
    const bool convex = cross(side, quad[(k + 2) % 4] - quad[(k + 1) % 4]) > 0.0;
    if (!convex) return std::nullopt;
  }
  return quad;
}

bool RegionQuadFitter::isSupported(const Quad& quad) const {
  double near_length = 0.0;
  double length = 0.0;
  for (std::size_t i = 0; i < traced_.size(); ++i) {
    const Eigen::Vector2d& p = traced_[i];
    const Eigen::Vector2d& q = traced_[(i + 1) % traced_.size()];
    const Eigen::Vector2d middle = 0.5 * (p + q);
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector2d& a = quad[k];
      const Eigen::Vector2d& b = quad[(k + 1) % 4];
      nearest = std::min(nearest, std::abs(outside(a, b, middle)) / (b - a).norm());
    }
    length += (q - p).norm();
    if (nearest < options_.support_px) near_length += (q - p).norm();
  }
  return near_length >= options_.min_support * length;
}

}  // namespace waymark::slam
