// The solution of a bundle adjustment's normal equations by the Schur complement: the more numerous
// kind of poses, cameras or markers, is eliminated pose by pose, and the others solved as one
// system. What depends on who sees whom is found out once, what depends on the values in each
// solve. Of a large map that system's factor costs as much as thirty products with it, and changes
// little from one iteration to the next: it stands in for the true one in conjugate gradients, and
// is made anew only where it is too far from it.
#pragma once

#include <optional>
#include <vector>

#include "base/task.h"
#include "slam/optimization/block_system.h"
#include "slam/optimization/normal_equations.h"

namespace waymark::slam {

struct BundleStep {
  std::vector<Vector6d> camera, marker;  // zero for fixed poses
  GlobalVector globals = GlobalVector::Zero();
};

class SchurComplement {
 public:
  // For problems with these ties and fixed poses.
  Task<Done> arrange(const BundleProblem& problem, Budget* budget);

  // Solves the damped equations; false when they are singular.
  Task<bool> solve(const BundleProblem& problem, const NormalEquations& equations, double lambda,
                   BundleStep* step, Budget* budget);
  // Covariance of the globals, whitened, all other unknowns free as well. Empty without globals.
  // The last solve() was of these equations, undamped.
  [[nodiscard]] std::optional<GlobalMatrix> globalsCovariance(const BundleProblem& problem) const;

 private:
  struct View {
    std::size_t tie = 0;
    int position = 0;  // of the kept pose, in the reduced system
  };
  static std::size_t at(int index) { return static_cast<std::size_t>(index); }
  Task<bool> solveDirectly(const BundleProblem& problem, const NormalEquations& equations,
                           double lambda, Budget* budget);
  // Both with the factor that is there. False where it is too far from the equations.
  Task<bool> solveIteratively(const BundleProblem& problem, const NormalEquations& equations,
                              double lambda, Budget* budget);
  // Preconditioned (Hestenes and Stiefel 1952), from zero on. residual: the right sides.
  Task<bool> conjugateGradients(const std::vector<Matrix6d>& diagonal,
                                std::vector<Vector6d> residual, Budget* budget);
  // What is left of the kept poses' system, times x; both by position.
  Task<Done> multiply(const std::vector<Matrix6d>& diagonal, const std::vector<Vector6d>& x,
                      std::vector<Vector6d>* result, Budget* budget) const;
  // The factor of an eliminated pose, and its views' cross blocks divided by it. False when its
  // block is singular.
  [[nodiscard]] bool factorize(std::size_t gone, const BundleProblem& problem,
                               const NormalEquations& equations, double lambda);
  [[nodiscard]] bool eliminate(std::size_t gone, const BundleProblem& problem,
                               const NormalEquations& equations, double lambda);
  void fillKept(const BundleProblem& problem, const NormalEquations& equations, double lambda);
  void substitute(std::size_t gone, bool with_globals, const GlobalVector& globals, Vector6d* step);

  bool cameras_go_ = true;
  std::vector<int> position_;  // of each kept pose; -1 for fixed ones
  std::vector<std::size_t>
      first_view_;                   // of each eliminated pose, and the end; fixed ones have none
  std::vector<View> views_;          // of kept poses that are not fixed, ascending by position
  std::vector<std::size_t> places_;  // of the blocks that two views of one pose meet in, in order
  std::vector<std::size_t> first_place_;
  std::vector<bool> goes_;  // by pose of that kind: not fixed, and seen
  BlockSystem reduced_;
  bool has_factor_ = false;  // of a system like this one, in reduced_
  // By view: the cross block, kept rows and eliminated columns, divided by the factor.
  std::vector<Matrix6d> Z_;
  // Of each eliminated pose: the factor of its damped block, and what it leaves of right side and
  // globals' rows, divided by it.
  std::vector<Matrix6d> factor_;
  std::vector<Vector6d> right_;
  std::vector<PoseGlobalMatrix> global_;
};

}  // namespace waymark::slam
