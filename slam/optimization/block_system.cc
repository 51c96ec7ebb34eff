#include "slam/optimization/block_system.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <utility>

#include <Eigen/Cholesky>

#include "base/distinct_indices.h"
#include "slam/geometry/small_cholesky.h"
#include "slam/optimization/block_kernels.h"

namespace waymark::slam {
namespace {

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kLookAtPose = 0.0007;
constexpr double kMergeEntry = 0.003;
constexpr double kNoteEntry = 0.011;  // of a shared block: hundreds that name few poses
constexpr double kSortEntry = 0.003;  // likewise
constexpr double kInvertProduct = 0.045;
constexpr double kSortRow = 0.04;
constexpr double kClearBlock = 0.02;
constexpr double kFreshBlock = 0.25;  // its memory is touched for the first time
constexpr double kSubstituteBlock = 0.02;
constexpr double kColumn = 0.1;
constexpr double kBlockProduct = 0.03;

// Of poses that share blocks, as they are eliminated one by one.
class EliminationGraph {
 public:
  explicit EliminationGraph(std::size_t poses)
      : neighbours_(poses), degrees_(poses, 0), distinct_(poses) {}

  // Each pair need be named once.
  void add(int pose, std::span<const int> neighbours) {
    for (const int j : neighbours) {
      neighbours_[at(pose)].push_back(j);
      neighbours_[at(j)].push_back(pose);
    }
  }
  // How often it was named so far.
  [[nodiscard]] std::size_t noted(int pose) const { return neighbours_[at(pose)].size(); }
  // Once all of its neighbours have been added.
  void complete(int pose) {
    distinct_.sort(&neighbours_[at(pose)]);
    std::erase(neighbours_[at(pose)], pose);
    degrees_[at(pose)] = static_cast<int>(neighbours_[at(pose)].size());
  }

  // The one with the fewest neighbours. Precondition: one is left.
  [[nodiscard]] int next() const {
    return static_cast<int>(std::ranges::min_element(degrees_) - degrees_.begin());
  }

  // Its neighbours, who are all neighbours of each other from here on.
  std::vector<int> eliminate(int pose) {
    degrees_[at(pose)] = std::numeric_limits<int>::max();
    std::vector<int> left = std::move(neighbours_[at(pose)]);
    for (const int j : left) {
      std::vector<int>& of_j = neighbours_[at(j)];
      merged_.clear();
      std::ranges::set_union(of_j, left, std::back_inserter(merged_));
      std::erase_if(merged_, [&](int k) { return k == j || k == pose; });
      std::swap(of_j, merged_);
      degrees_[at(j)] = static_cast<int>(of_j.size());
    }
    return left;
  }

 private:
  static std::size_t at(int pose) { return static_cast<std::size_t>(pose); }

  std::vector<std::vector<int>> neighbours_;  // sorted
  std::vector<int> degrees_;  // how many those are; of one that is gone, more than any
  std::vector<int> merged_;
  DistinctIndices distinct_;
};

}  // namespace

Task<Done> BlockSystem::arrange(std::vector<std::vector<int>> neighbours, bool with_globals,
                                Budget* budget) {
  with_globals_ = with_globals;
  const std::size_t poses = neighbours.size();
  EliminationGraph graph(poses);
  for (int i = 0; i < static_cast<int>(poses); ++i) {
    co_await budget->spend(kColumn + kNoteEntry * static_cast<double>(neighbours[at(i)].size()));
    graph.add(i, neighbours[at(i)]);
    neighbours[at(i)] = {};
  }
  for (int i = 0; i < static_cast<int>(poses); ++i) {
    co_await budget->spend(kColumn + kSortEntry * static_cast<double>(graph.noted(i)));
    graph.complete(i);
  }
  position_.assign(poses, -1);
  std::vector<std::vector<int>> columns(poses);  // as poses
  for (std::size_t step = 0; step < poses; ++step) {
    const int pose = graph.next();
    position_[at(pose)] = static_cast<int>(step);
    columns[step] = graph.eliminate(pose);
    const auto below = static_cast<double>(columns[step].size());
    co_await budget->spend(kLookAtPose * static_cast<double>(poses) + kMergeEntry * below * below);
  }
  first_.clear();
  rows_.clear();
  for (std::size_t column = 0; column < poses; ++column) {
    co_await budget->spend(kColumn + kSortRow * static_cast<double>(columns[column].size()));
    first_.push_back(rows_.size());
    rows_.push_back(static_cast<int>(column));
    for (const int pose : columns[column]) rows_.push_back(positionOf(pose));
    std::sort(rows_.begin() + static_cast<std::ptrdiff_t>(first_.back()), rows_.end());
  }
  first_.push_back(rows_.size());
  blocks_.clear();
  blocks_.reserve(rows_.size());  // takes no time: the memory is touched below
  for (std::size_t column = 0; column < poses; ++column) {
    const std::size_t begin = blocks_.size();
    co_await budget->spend(kFreshBlock * static_cast<double>(first_[column + 1] - begin));
    blocks_.resize(first_[column + 1]);
    for (std::size_t i = begin; i < blocks_.size(); ++i) blocks_[i].setZero();
  }
  right_.assign(poses, Vector6d::Zero());
  global_blocks_.assign(with_globals ? poses : 0, PoseGlobalMatrix::Zero());
  globals_.setZero();
  global_right_.setZero();
  co_return Done{};
}

std::size_t BlockSystem::place(int row, int column) const {
  const auto begin = rows_.begin() + static_cast<std::ptrdiff_t>(first_[at(column)]);
  const auto end = rows_.begin() + static_cast<std::ptrdiff_t>(first_[at(column) + 1]);
  return static_cast<std::size_t>(std::lower_bound(begin, end, row) - rows_.begin());
}

std::span<const int> BlockSystem::below(int column) const {
  return std::span(rows_).subspan(first_[at(column)] + 1,
                                  first_[at(column) + 1] - first_[at(column)] - 1);
}

std::optional<std::size_t> BlockSystem::findPlace(int row, int column) const {
  const std::size_t found = place(row, column);
  if (found == first_[at(column) + 1] || rows_[found] != row) return std::nullopt;
  return found;
}

Task<Done> BlockSystem::clear(Budget* budget) {
  for (int column = 0; column < poses(); ++column) {
    co_await budget->spend(kClearBlock * static_cast<double>(1 + below(column).size()));
    for (std::size_t i = first_[at(column)]; i < first_[at(column) + 1]; ++i) blocks_[i].setZero();
  }
  std::ranges::fill(right_, Vector6d::Zero());
  std::ranges::fill(global_blocks_, PoseGlobalMatrix::Zero());
  globals_.setZero();
  global_right_.setZero();
  co_return Done{};
}

Task<bool> BlockSystem::solve(Budget* budget) {
  for (int column = 0; column < poses(); ++column) {
    // The last columns of a large map have hundreds of rows.
    const std::size_t rows = below(column).size();
    co_await budget->spend(kColumn + kBlockProduct * static_cast<double>(rows));
    if (!factorizeColumn(column)) co_return false;
    for (std::size_t j = 0; j < rows; ++j) {
      co_await budget->spend(kBlockProduct * static_cast<double>(rows - j));
      subtractFromLater(column, j);
    }
  }
  if (!solveGlobals()) co_return false;
  co_return co_await substituteBackward(budget);
}

Task<bool> BlockSystem::solveAgain(Budget* budget) {
  for (int column = 0; column < poses(); ++column) {
    co_await budget->spend(kColumn + kSubstituteBlock * static_cast<double>(below(column).size()));
    substituteForward(column);
  }
  co_return co_await substituteBackward(budget);
}

Task<bool> BlockSystem::substituteBackward(Budget* budget) {
  for (int column = poses() - 1; column >= 0; --column) {
    co_await budget->spend(kColumn + kSubstituteBlock * static_cast<double>(below(column).size()));
    substituteBackward(column);
    if (!right(column).allFinite()) co_return false;
  }
  co_return true;
}

bool BlockSystem::factorizeColumn(int column) {
  Matrix6d& L = diagonal(column);
  if (!factorizeCholesky(&L)) return false;
  const std::span<const int> rows = below(column);
  Matrix6d* const blocks = blocks_.data() + first_[at(column)] + 1;
  for (std::size_t i = 0; i < rows.size(); ++i) divideByTransposed(L, &blocks[i]);
  substituteForward(column);
  if (with_globals_) {
    PoseGlobalMatrix& B = globalBlock(column);
    solveLower(L, &B);
    globals_.noalias() -= B.transpose() * B;
    global_right_.noalias() -= B.transpose() * right(column);
  }
  return true;
}

// From the column of its j-th row below the diagonal.
void BlockSystem::subtractFromLater(int column, std::size_t j) {
  const std::span<const int> rows = below(column);
  const Matrix6d* const blocks = blocks_.data() + first_[at(column)] + 1;
  if (with_globals_) globalBlock(rows[j]).noalias() -= blocks[j] * globalBlock(column);
  // The later column has all these rows, and others between them.
  std::size_t target = first_[at(rows[j])];
  for (std::size_t i = j; i < rows.size(); ++i) {
    while (rows_[target] != rows[i]) ++target;
    subtractProduct(blocks[i], blocks[j], &blocks_[target]);
  }
}

bool BlockSystem::solveGlobals() {
  if (!with_globals_) return true;
  const Eigen::LLT<GlobalMatrix> factor(globals_);
  if (factor.info() != Eigen::Success) return false;
  global_right_ = factor.solve(global_right_).eval();
  return global_right_.allFinite();
}

void BlockSystem::substituteForward(int column) {
  solveLower(diagonal(column), &right(column));
  const std::span<const int> rows = below(column);
  const Matrix6d* const blocks = blocks_.data() + first_[at(column)] + 1;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    right(rows[i]).noalias() -= blocks[i] * right(column);
  }
}

void BlockSystem::substituteBackward(int column) {
  Vector6d& x = right(column);
  if (with_globals_) x.noalias() -= globalBlock(column) * global_right_;
  const std::span<const int> rows = below(column);
  const Matrix6d* const blocks = blocks_.data() + first_[at(column)] + 1;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    x.noalias() -= blocks[i].transpose() * right(rows[i]);
  }
  solveLowerTransposed(diagonal(column), &x);
}

// With a column L of the factor and the inverse Z of all later ones: Z_ij = -sum_k Z_ik Y_k below
// the diagonal, Y_k = L_kj L_jj^-1; on it L_jj^-T L_jj^-1 - sum_k Y_k^T Z_kj.
Task<Done> BlockSystem::invert(Budget* budget) {
  std::vector<Matrix6d> Y;
  for (int column = poses() - 1; column >= 0; --column) {
    const std::size_t rows = below(column).size();
    co_await budget->spend(kColumn + 2.0 * kInvertProduct * static_cast<double>(rows));
    Matrix6d L_inverse = Matrix6d::Identity();
    solveLower(diagonal(column), &L_inverse);
    takeOut(column, L_inverse, &Y);
    for (std::size_t k = 0; k < rows; ++k) {
      co_await budget->spend(2.0 * kInvertProduct * static_cast<double>(rows - k));
      subtractLater(column, k, Y);
    }
    Matrix6d& on_diagonal = diagonal(column);
    on_diagonal.noalias() = L_inverse.transpose() * L_inverse;
    for (std::size_t i = 0; i < rows; ++i) {
      on_diagonal.noalias() -= Y[i].transpose() * blocks_[first_[at(column)] + 1 + i];
    }
  }
  co_return Done{};
}

// The Y_k of a column, and zeros in their place.
void BlockSystem::takeOut(int column, const Matrix6d& L_inverse, std::vector<Matrix6d>* Y) {
  const std::size_t rows = below(column).size();
  Matrix6d* const blocks = blocks_.data() + first_[at(column)] + 1;
  Y->resize(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    (*Y)[i].noalias() = blocks[i] * L_inverse;
    blocks[i].setZero();
  }
}

// What the inverse has in the later column of the k-th row, and in its row: it is symmetric.
void BlockSystem::subtractLater(int column, std::size_t k, const std::vector<Matrix6d>& Y) {
  const std::span<const int> rows = below(column);
  Matrix6d* const blocks = blocks_.data() + first_[at(column)] + 1;
  // The later column has all these rows, and others between them.
  std::size_t place = first_[at(rows[k])];
  blocks[k].noalias() -= blocks_[place] * Y[k];
  for (std::size_t i = k + 1; i < rows.size(); ++i) {
    while (rows_[place] != rows[i]) ++place;
    blocks[i].noalias() -= blocks_[place] * Y[k];
    blocks[k].noalias() -= blocks_[place].transpose() * Y[i];
  }
}

std::optional<GlobalMatrix> BlockSystem::globalsCovariance() const {
  const Eigen::LLT<GlobalMatrix> factor(globals_);
  if (factor.info() != Eigen::Success) return std::nullopt;
  return GlobalMatrix(factor.solve(GlobalMatrix::Identity()));
}

}  // namespace waymark::slam
