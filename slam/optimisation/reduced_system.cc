#include "slam/optimisation/reduced_system.h"

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>

namespace waymark::slam {
namespace {

// Up to here a dense factorisation is faster than finding out what is zero.
constexpr int kLargestDense = 900;  // unknowns

}  // namespace

ReducedSystem::ReducedSystem(int poses, bool with_globals)
    : pose_unknowns_(6 * poses), dense_(6 * poses <= kLargestDense) {
  const int globals = with_globals ? BundleProblem::kGlobals : 0;
  if (dense_) lower_.setZero(pose_unknowns_ + globals, pose_unknowns_ + globals);
  global_rows_.setZero(globals, pose_unknowns_ + globals);
  right_.setZero(pose_unknowns_ + globals);
}

void ReducedSystem::addBlock(int row, int column, const Matrix6d& block) {
  if (dense_) {
    lower_.block<6, 6>(6 * row, 6 * column) += block;
  } else {
    blocks_.try_emplace({row, column}, Matrix6d::Zero()).first->second += block;
  }
}

void ReducedSystem::addGlobalBlock(int row, const PoseGlobalMatrix& block) {
  global_rows_.block<BundleProblem::kGlobals, 6>(0, 6 * row) += block.transpose();
}

void ReducedSystem::addGlobals(const GlobalMatrix& block, const GlobalVector& right) {
  global_rows_.rightCols<BundleProblem::kGlobals>() += block;
  right_.tail<BundleProblem::kGlobals>() += right;
}

std::optional<double> ReducedSystem::lastVariance() const {
  const auto column = solveFor(Eigen::VectorXd::Unit(right_.size(), right_.size() - 1));
  if (!column) return std::nullopt;
  return (*column)[right_.size() - 1];
}

std::optional<Eigen::VectorXd> ReducedSystem::solveFor(const Eigen::VectorXd& right) const {
  if (right.size() == 0) return Eigen::VectorXd();
  if (!dense_) return solveSparse(right);
  Eigen::MatrixXd S = lower_;
  if (global_rows_.rows() > 0) S.bottomRows<BundleProblem::kGlobals>() = global_rows_;
  const Eigen::LLT<Eigen::MatrixXd, Eigen::Lower> factor(S);
  if (factor.info() != Eigen::Success) return std::nullopt;
  Eigen::VectorXd x = factor.solve(right);
  if (!x.allFinite()) return std::nullopt;
  return x;
}

std::optional<Eigen::VectorXd> ReducedSystem::solveSparse(const Eigen::VectorXd& right) const {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(36 * blocks_.size() + static_cast<std::size_t>(global_rows_.size()));
  for (const auto& [place, block] : blocks_) {
    const auto [row, column] = place;
    for (int j = 0; j < 6; ++j) {
      for (int i = row == column ? j : 0; i < 6; ++i) {
        entries.emplace_back(6 * row + i, 6 * column + j, block(i, j));
      }
    }
  }
  for (int i = 0; i < global_rows_.rows(); ++i) {
    for (int j = 0; j <= pose_unknowns_ + i; ++j) {
      entries.emplace_back(pose_unknowns_ + i, j, global_rows_(i, j));
    }
  }
  Eigen::SparseMatrix<double> S(right.size(), right.size());
  S.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Lower> factor(S);
  if (factor.info() != Eigen::Success) return std::nullopt;
  Eigen::VectorXd x = factor.solve(right);
  if (!x.allFinite()) return std::nullopt;
  return x;
}

}  // namespace waymark::slam
