// Pose graph optimization (seed 1, Eq. 37-39): spreads the difference found at a loop's end over
// the keyframes of the loop.
#pragma once

#include <string>
#include <vector>

#include "base/task.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

struct PoseGraph {
  struct Edge {
    int a = 0;  // indices into poses
    int b = 0;
    Transform T_a_b;      // as measured (Eq. 37)
    double weight = 1.0;  // of the squared error
  };
  std::vector<Transform> poses;  // T_w_i
  std::vector<Edge> edges;
  int fixed = 0;  // this pose does not move
};

struct PoseGraphOptions {
  // More spread the difference better and cost time; the optimization that follows does the rest.
  int max_iterations = 20;
  // Stop when an iteration lowers the cost by less than this share of it.
  double min_relative_decrease = 1e-6;
  // One metre of an edge's error counts as much as this many radians. Larger bends the loop where
  // it turned, smaller stretches it.
  double radians_per_metre = 0.5;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct PoseGraphSummary {
  double initial_cost = 0.0;
  double final_cost = 0.0;
  int iterations = 0;
};

// Levenberg-Marquardt on Eq. 39, sparse. Improves the poses in place.
Task<PoseGraphSummary> optimizePoseGraph(PoseGraph* graph, const PoseGraphOptions& options,
                                         Budget* budget);

// An edge's error: translation in metres times radians_per_metre, then rotation vector, radians.
[[nodiscard]] Vector6d edgeError(const Transform& T_w_a, const Transform& T_w_b,
                                 const Transform& T_a_b, double radians_per_metre);
// Its derivatives by (dp, dtheta) of both poses (Transform::retract).
struct EdgeJacobians {
  Matrix6d a, b;
};
[[nodiscard]] EdgeJacobians edgeJacobians(const Transform& T_w_a, const Transform& T_w_b,
                                          const Transform& T_a_b, double radians_per_metre);

}  // namespace waymark::slam
