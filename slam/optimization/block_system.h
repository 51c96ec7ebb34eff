// A symmetric positive definite system of 6x6 blocks, one row of them a pose, most of them zero;
// and the rows of the globals (intrinsics, readout) at the end where they are unknowns. Solved by a
// sparse Cholesky factorization, block by block, in slices.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "base/task.h"
#include "slam/optimization/bundle_problem.h"

namespace waymark::slam {

class BlockSystem {
 public:
  // Chooses an order of elimination that keeps most blocks zero (the pose with the fewest
  // neighbours next), and makes room for all others. neighbours: by pose, those it shares a block
  // with; a pair may be named from one side or from both. Positions below are those in this order.
  Task<Done> arrange(std::vector<std::vector<int>> neighbours, bool with_globals, Budget* budget);
  [[nodiscard]] int poses() const { return static_cast<int>(position_.size()); }
  [[nodiscard]] int positionOf(int pose) const { return position_[static_cast<std::size_t>(pose)]; }
  // Where the block of two positions is kept. Preconditions: row >= column; they share a block.
  [[nodiscard]] std::size_t place(int row, int column) const;

  // All blocks and right sides become zero.
  Task<Done> clear(Budget* budget);
  [[nodiscard]] Matrix6d& block(std::size_t place) { return blocks_[place]; }
  [[nodiscard]] Matrix6d& diagonal(int position) { return blocks_[first_[at(position)]]; }
  [[nodiscard]] Vector6d& right(int position) { return right_[at(position)]; }
  // Rows of a pose, columns of the globals.
  [[nodiscard]] PoseGlobalMatrix& globalBlock(int position) { return global_blocks_[at(position)]; }
  [[nodiscard]] GlobalMatrix& globals() { return globals_; }
  [[nodiscard]] GlobalVector& globalRight() { return global_right_; }

  // Factorizes, in place, and leaves the solution in the right sides. False when the system is not
  // positive definite, or the solution not finite.
  Task<bool> solve(Budget* budget);
  // The same for other right sides, with the factor that is there. After solve(), without globals.
  Task<bool> solveAgain(Budget* budget);
  // The blocks become those of the inverse, where the factor has blocks: Takahashi's recursion,
  // from the last column to the first. After solve(), without globals.
  Task<Done> invert(Budget* budget);
  // As place(); empty where two positions share no block of the factor.
  [[nodiscard]] std::optional<std::size_t> findPlace(int row, int column) const;
  // Of the globals: their part of the inverse. After solve(), with globals.
  [[nodiscard]] std::optional<GlobalMatrix> globalsCovariance() const;

 private:
  static std::size_t at(int index) { return static_cast<std::size_t>(index); }
  // The blocks below the diagonal in a column, as positions of rows.
  [[nodiscard]] std::span<const int> below(int column) const;
  // But for what it subtracts from later ones.
  [[nodiscard]] bool factorizeColumn(int column);
  void subtractFromLater(int column, std::size_t j);
  [[nodiscard]] bool solveGlobals();
  Task<bool> substituteBackward(Budget* budget);
  void substituteForward(int column);
  void substituteBackward(int column);
  void takeOut(int column, const Matrix6d& L_inverse, std::vector<Matrix6d>* Y);
  void subtractLater(int column, std::size_t k, const std::vector<Matrix6d>& Y);

  bool with_globals_ = false;
  std::vector<int> position_;       // by pose
  std::vector<std::size_t> first_;  // of each column's places, the diagonal; and the end
  std::vector<int> rows_;           // by place
  std::vector<Matrix6d> blocks_;    // by place; the factor once solved
  std::vector<Vector6d> right_;
  std::vector<PoseGlobalMatrix> global_blocks_;  // empty without globals
  GlobalMatrix globals_ = GlobalMatrix::Zero();
  GlobalVector global_right_ = GlobalVector::Zero();
};

}  // namespace waymark::slam
