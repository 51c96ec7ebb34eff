// Points that have gone out of view: where they are, and what they look like, for when they come
// back into view. What was told of them then is what is told of the camera again: however far it
// has drifted meanwhile, it comes back to where it was.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/transform.h"
#include "slam/natural/filter/feature_search.h"

namespace waymark::slam {

struct RememberedPoint {
  FeatureLook look;
  Eigen::Vector2d uv = Eigen::Vector2d::Zero();  // StateFeature
  double rho = 0.0;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // of (u, v, rho)
  int age = 0;                                           // frames
};

// The camera that first saw some points, and those of them that are remembered.
struct RememberedView {
  std::uint64_t anchor = 0;  // its number
  bool recalled = false;     // some of its points are in use again, and it with them
  Transform T_w_a;
  // Of (dp, dtheta) as Transform::retract, as it was when the first of the points was left: what
  // they have in common.
  Matrix6d covariance = Matrix6d::Zero();
  std::vector<RememberedPoint> points{};

  // Of the position.
  [[nodiscard]] double variance() const { return covariance.topLeftCorner<3, 3>().trace(); }
};

// A bounded number of points: those of the views that are known best.
class PointMemory {
 public:
  // Takes all the memory it needs.
  PointMemory(int max_views, int max_points_per_view);

  // Leaves it out where it has no place.
  void add(std::uint64_t anchor, const Transform& T_w_a, const Matrix6d& covariance,
           const RememberedPoint& point);
  // Those in use.
  [[nodiscard]] std::span<const RememberedView> views() const { return {views_.data(), used_}; }
  [[nodiscard]] RememberedView& view(std::size_t i) { return views_[i]; }
  void forget(std::size_t view);
  void clear() { used_ = 0; }
  // The world's coordinates have changed.
  void moveWorld(const Transform& T_new_old);

 private:
  std::vector<RememberedView> views_;  // all that there may be
  std::size_t used_ = 0;               // of these, the first ones
  std::size_t max_points_;
};

}  // namespace waymark::slam
