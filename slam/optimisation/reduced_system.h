// The symmetric system that the Schur complement leaves: 6x6 blocks, and the rows of the globals
// (intrinsics, readout) at the end where they are unknowns. Small ones are solved densely, large
// ones sparsely.
#pragma once

#include <map>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "slam/optimisation/bundle_problem.h"

namespace waymark::slam {

class ReducedSystem {
 public:
  ReducedSystem(int poses, bool with_globals);

  // Precondition: row >= column.
  void addBlock(int row, int column, const Matrix6d& block);
  void addRight(int row, const Vector6d& value) { right_.segment<6>(6 * row) += value; }
  // Rows of a pose, columns of the globals.
  void addGlobalBlock(int row, const PoseGlobalMatrix& block);
  void addGlobals(const GlobalMatrix& block, const GlobalVector& right);

  // Empty when the system is not positive definite.
  [[nodiscard]] std::optional<Eigen::VectorXd> solve() const { return solveFor(right_); }
  // Variance of the last unknown: the last entry of the inverse.
  [[nodiscard]] std::optional<double> lastVariance() const;

 private:
  [[nodiscard]] std::optional<Eigen::VectorXd> solveFor(const Eigen::VectorXd& right) const;
  [[nodiscard]] std::optional<Eigen::VectorXd> solveSparse(const Eigen::VectorXd& right) const;

  int pose_unknowns_;
  bool dense_;
  Eigen::MatrixXd lower_;                           // dense: the lower triangle
  std::map<std::pair<int, int>, Matrix6d> blocks_;  // sparse
  Eigen::MatrixXd global_rows_;                     // by all columns; no rows without globals
  Eigen::VectorXd right_;
};

}  // namespace waymark::slam
