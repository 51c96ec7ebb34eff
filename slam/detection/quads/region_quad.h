// The quadrilateral that a dark region fills, if it does.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "slam/detection/quads/dark_regions.h"

namespace waymark::slam {

// Corners in pixels (pixel centres), clockwise in the image, good to about a pixel.
using Quad = std::array<Eigen::Vector2d, 4>;

struct RegionQuadOptions {
  // Shortest side of a candidate, pixels.
  double min_side_px = 7.0;
  // Largest deviation of the outline's convex hull from the quad, as a share of the perimeter, and
  // in pixels; the larger one counts, as small outlines are steps of a pixel.
  double outline_tolerance = 0.03;
  double outline_tolerance_px = 1.5;
  // Least share of the outline that runs along the quad's sides: light cells of the code may break
  // through a blurred border.
  double min_support = 0.6;
  // Nearer than this the outline runs along a side, pixels.
  double support_px = 1.5;
  // A side's line is fitted without this share at either end, which bends around the corner.
  double side_end = 0.125;
  // Farthest between a vertex and where its sides meet, pixels: beyond it the sides are not the
  // vertices' any more.
  double max_corner_shift_px = 6.0;
  // Of two vertices, the least distance before their lines are fitted, as a share of the shortest
  // side.
  double min_vertex_distance = 0.5;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

class RegionQuadFitter {
 public:
  explicit RegionQuadFitter(const RegionQuadOptions& options = {}) : options_(options) {}

  // Empty when the outline has not four straight sides.
  [[nodiscard]] std::optional<Quad> fit(const DarkRegion& region);

 private:
  // Indices into outline_, in its order.
  using Vertices = std::array<std::size_t, 4>;
  struct Farthest {
    std::size_t index;
    double distance;
  };

  void traceOutline(const DarkRegion& region);
  void fillNotches();
  [[nodiscard]] std::size_t next(std::size_t i) const {
    return i + 1 == outline_.size() ? 0 : i + 1;
  }
  [[nodiscard]] std::size_t farthestFrom(const Eigen::Vector2d& p) const;
  [[nodiscard]] Farthest farthestBetween(std::size_t from, std::size_t to) const;
  [[nodiscard]] std::optional<Vertices> findVertices() const;
  [[nodiscard]] bool sidesAreStraight(const Vertices& vertices) const;
  [[nodiscard]] bool isSupported(const Quad& quad) const;
  [[nodiscard]] std::optional<Quad> intersectSides(const Vertices& vertices) const;
  [[nodiscard]] Eigen::Vector3d fitSide(std::size_t from, std::size_t to) const;

  RegionQuadOptions options_;
  // Closed lines, clockwise in the image.
  std::vector<Eigen::Vector2d> traced_;   // as it is
  std::vector<Eigen::Vector2d> outline_;  // its convex hull
};

}  // namespace waymark::slam
