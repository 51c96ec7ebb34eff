// The symmetric system that the Schur complement leaves: 6x6 blocks, and nine rows of intrinsics at
// the end where they are unknowns. Small ones are solved densely, large ones sparsely.
#pragma once

#include <map>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

class ReducedSystem {
 public:
  ReducedSystem(int poses, bool with_lens);

  // Precondition: row >= column.
  void addBlock(int row, int column, const Matrix6d& block);
  void addRight(int row, const Vector6d& value) { right_.segment<6>(6 * row) += value; }
  // Rows of a pose, columns of the intrinsics.
  void addLensBlock(int row, const Eigen::Matrix<double, 6, 9>& block);
  void addLens(const Eigen::Matrix<double, 9, 9>& block, const IntrinsicVector& right);

  // Empty when the system is not positive definite.
  [[nodiscard]] std::optional<Eigen::VectorXd> solve() const;

 private:
  [[nodiscard]] std::optional<Eigen::VectorXd> solveSparse() const;

  int pose_unknowns_;
  bool dense_;
  Eigen::MatrixXd lower_;                           // dense: the lower triangle
  std::map<std::pair<int, int>, Matrix6d> blocks_;  // sparse
  Eigen::MatrixXd lens_rows_;                       // 9 rows (or none) by all columns
  Eigen::VectorXd right_;
};

}  // namespace waymark::slam
