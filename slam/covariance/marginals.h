// How well the places of a map's markers are known in its world: marginal covariances, and those
// between markers that are seen together, the camera as it is; and how they move with the camera's
// parameters.
#pragma once

#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "slam/geometry/transform.h"
#include "slam/optimization/bundle_problem.h"

namespace waymark::slam {

class MapMarginals {
 public:
  // Of (dp, dtheta) of T_w_m: metres and radians, in the world frame. Null for markers whose place
  // was not known when these were computed.
  [[nodiscard]] const Matrix6d* find(int marker) const;
  // E[delta_a delta_b^T], rows of a, columns of b; empty where it was not computed: the two are far
  // from each other. Precondition: find() knows both.
  [[nodiscard]] std::optional<Matrix6d> between(int a, int b) const;
  // The same in place: rows of the smaller id. Null where it was not computed, and for a = b.
  [[nodiscard]] const Matrix6d* findBetween(int a, int b) const;
  [[nodiscard]] bool empty() const { return own_.empty(); }
  // All of them, by id.
  [[nodiscard]] const std::map<int, Matrix6d>& markers() const { return own_; }

  // d (dp, dtheta) / d parameters of the camera (CameraUncertainty) of a marker whose views are
  // those of a camera with other parameters; null where nobody knows.
  [[nodiscard]] const PoseGlobalMatrix* byCamera(int marker) const;

  void set(int marker, const Matrix6d& covariance) { own_[marker] = covariance; }
  void setByCamera(int marker, const PoseGlobalMatrix& by_camera) {
    by_camera_[marker] = by_camera;
  }
  // Preconditions: set() has given both; a < b; pairs come in the order of b, then of a.
  void appendBetween(int a, int b, const Matrix6d& covariance) {
    pairs_.push_back({b, a});
    between_.push_back(covariance);
  }

 private:
  std::map<int, Matrix6d> own_;
  std::map<int, PoseGlobalMatrix> by_camera_;
  std::vector<std::pair<int, int>> pairs_;  // the larger id first, ascending
  std::vector<Matrix6d> between_;           // as pairs_; rows of the smaller id
};

}  // namespace waymark::slam
