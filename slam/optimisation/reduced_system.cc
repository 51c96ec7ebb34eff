#include "slam/optimisation/reduced_system.h"

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>

namespace waymark::slam {
namespace {

// Up to here a dense factorisation is faster than finding out what is zero.
constexpr int kLargestDense = 900;  // unknowns

}  // namespace

ReducedSystem::ReducedSystem(int poses, bool with_lens)
    : pose_unknowns_(6 * poses), dense_(6 * poses <= kLargestDense) {
  const int lens = with_lens ? 9 : 0;
  if (dense_) lower_.setZero(pose_unknowns_ + lens, pose_unknowns_ + lens);
  lens_rows_.setZero(lens, pose_unknowns_ + lens);
  right_.setZero(pose_unknowns_ + lens);
}

void ReducedSystem::addBlock(int row, int column, const Matrix6d& block) {
  if (dense_) {
    lower_.block<6, 6>(6 * row, 6 * column) += block;
  } else {
    blocks_.try_emplace({row, column}, Matrix6d::Zero()).first->second += block;
  }
}

void ReducedSystem::addLensBlock(int row, const Eigen::Matrix<double, 6, 9>& block) {
  lens_rows_.block<9, 6>(0, 6 * row) += block.transpose();
}

void ReducedSystem::addLens(const Eigen::Matrix<double, 9, 9>& block,
                            const IntrinsicVector& right) {
  lens_rows_.rightCols<9>() += block;
  right_.tail<9>() += right;
}

std::optional<Eigen::VectorXd> ReducedSystem::solve() const {
  if (right_.size() == 0) return Eigen::VectorXd();
  if (!dense_) return solveSparse();
  Eigen::MatrixXd S = lower_;
  if (lens_rows_.rows() > 0) S.bottomRows<9>() = lens_rows_;
  const Eigen::LLT<Eigen::MatrixXd, Eigen::Lower> factor(S);
  if (factor.info() != Eigen::Success) return std::nullopt;
  Eigen::VectorXd x = factor.solve(right_);
  if (!x.allFinite()) return std::nullopt;
  return x;
}

std::optional<Eigen::VectorXd> ReducedSystem::solveSparse() const {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(36 * blocks_.size() + static_cast<std::size_t>(lens_rows_.size()));
  for (const auto& [place, block] : blocks_) {
    const auto [row, column] = place;
    for (int j = 0; j < 6; ++j) {
      for (int i = row == column ? j : 0; i < 6; ++i) {
        entries.emplace_back(6 * row + i, 6 * column + j, block(i, j));
      }
    }
  }
  for (int i = 0; i < lens_rows_.rows(); ++i) {
    for (int j = 0; j <= pose_unknowns_ + i; ++j) {
      entries.emplace_back(pose_unknowns_ + i, j, lens_rows_(i, j));
    }
  }
  Eigen::SparseMatrix<double> S(right_.size(), right_.size());
  S.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Lower> factor(S);
  if (factor.info() != Eigen::Success) return std::nullopt;
  Eigen::VectorXd x = factor.solve(right_);
  if (!x.allFinite()) return std::nullopt;
  return x;
}

}  // namespace waymark::slam
