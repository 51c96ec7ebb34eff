// How a surface lies around a feature, from its neighbours' depths: over a plane the inverse depth
// is linear in the image.
#pragma once

#include <optional>
#include <span>

#include <Eigen/Core>

namespace waymark::slam {

// A neighbour, from the feature.
struct SurfacePoint {
  Eigen::Vector2d offset = Eigen::Vector2d::Zero();  // normalized coordinates
  double relative = 0.0;                             // its inverse depth over the feature's, less 1
  double sigma = 0.0;                                // of that
};

// Gradient of the relative inverse depth by normalized coordinates: zero faces the anchor, its norm
// is the tangent of the angle that the surface is turned by (at the image's middle). Empty with
// fewer than five neighbours, with those in a row, and where they lie in no plane.
[[nodiscard]] std::optional<Eigen::Vector2d> surfaceGradient(std::span<const SurfacePoint> points);

}  // namespace waymark::slam
