#include "slam/optimization/schur_complement.h"

#include <algorithm>
#include <utility>

#include "slam/geometry/small_cholesky.h"
#include "slam/optimization/block_kernels.h"

namespace waymark::slam {
namespace {

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kPose = 0.15;
constexpr double kView = 0.08;
constexpr double kViewPair = 0.03;
constexpr double kNoteView = 0.015;
constexpr double kNotePair = 0.01;
constexpr double kFindPlace = 0.016;
constexpr double kMultiplyView = 0.03;
constexpr double kMoveVector = 0.01;

// Fewer kept poses than this are solved directly: it costs no more.
constexpr int kFewPoses = 300;
// The step is good enough when what is left of the system's decrease is this small a part of it,
// but in units of the noise, which the equations are in, not more than that, nor need it be less.
// (Most of a large decrease is that of single views. What bends a whole map is the rest, and comes
// last.)
constexpr double kLeftOfDecrease = 1e-5;
constexpr double kLeastLeft = 0.01;
constexpr double kMostLeft = 0.1;
constexpr int kMostIterations = 30;

Matrix6d damped(const Matrix6d& H, double lambda) {
  Matrix6d result = H;
  result.diagonal() *= 1.0 + lambda;
  result.diagonal().array() += 1e-12;  // positive definite also for a pose that nothing observes
  return result;
}

double pairs(std::size_t n) { return 0.5 * static_cast<double>(n * (n + 1)); }

}  // namespace

Task<Done> SchurComplement::arrange(const BundleProblem& problem, Budget* budget) {
  has_factor_ = false;
  cameras_go_ = problem.cameras.size() >= problem.markers.size();
  const auto& gone = cameras_go_ ? problem.cameras : problem.markers;
  const auto& kept = cameras_go_ ? problem.markers : problem.cameras;
  const auto goneOf = [this](const BundleProblem::Tie& o) {
    return at(cameras_go_ ? o.camera : o.marker);
  };
  const auto keptOf = [this](const BundleProblem::Tie& o) {
    return at(cameras_go_ ? o.marker : o.camera);
  };

  // Among the poses that stay: which are unknowns, and which meet in an eliminated one.
  std::vector<int> index(kept.size(), -1);
  int unknowns = 0;
  for (std::size_t i = 0; i < kept.size(); ++i) {
    if (!kept[i].fixed) index[i] = unknowns++;
  }
  goes_.assign(gone.size(), false);
  std::vector<std::vector<std::size_t>> seen(gone.size());
  for (std::size_t o = 0; o < problem.ties(); ++o) {
    co_await budget->spend(kNoteView);
    const std::size_t e = goneOf(problem.tie(o));
    if (gone[e].fixed) continue;
    goes_[e] = true;
    if (index[keptOf(problem.tie(o))] >= 0) seen[e].push_back(o);
  }
  std::vector<std::vector<int>> neighbours(at(unknowns));
  std::size_t places = 0;
  for (const auto& views : seen) {
    co_await budget->spend(kPose + kNotePair * pairs(views.size()));
    places += views.size() * (views.size() + 1) / 2;
    for (const std::size_t a : views) {
      const int i = index[keptOf(problem.tie(a))];
      for (const std::size_t b : views) {
        const int j = index[keptOf(problem.tie(b))];
        if (j < i) neighbours[at(i)].push_back(j);
      }
    }
  }
  (void)co_await reduced_.arrange(std::move(neighbours), problem.hasGlobals(), budget);

  position_.assign(kept.size(), -1);
  for (std::size_t i = 0; i < kept.size(); ++i) {
    if (index[i] >= 0) position_[i] = reduced_.positionOf(index[i]);
  }
  first_view_.clear();
  first_place_.clear();
  views_.clear();
  places_.clear();
  views_.reserve(problem.ties());
  places_.reserve(places);
  const auto positionOf = [&](std::size_t o) { return position_[keptOf(problem.tie(o))]; };
  for (auto& observations : seen) {
    co_await budget->spend(kPose + kFindPlace * pairs(observations.size()));
    first_view_.push_back(views_.size());
    first_place_.push_back(places_.size());
    std::ranges::sort(observations, {}, positionOf);
    for (const std::size_t o : observations) views_.push_back({o, positionOf(o)});
    for (std::size_t b = first_view_.back(); b < views_.size(); ++b) {
      for (std::size_t a = b; a < views_.size(); ++a) {
        places_.push_back(reduced_.place(views_[a].position, views_[b].position));
      }
    }
  }
  first_view_.push_back(views_.size());
  Z_.resize(views_.size());
  factor_.resize(gone.size());
  right_.resize(gone.size());
  global_.resize(problem.hasGlobals() ? gone.size() : 0);
  co_return Done{};
}

Task<bool> SchurComplement::solve(const BundleProblem& problem, const NormalEquations& equations,
                                  double lambda, BundleStep* step, Budget* budget) {
  bool solved = false;
  if (has_factor_) solved = co_await solveIteratively(problem, equations, lambda, budget);
  if (!solved) solved = co_await solveDirectly(problem, equations, lambda, budget);
  if (!solved) co_return false;

  step->globals = problem.hasGlobals() ? reduced_.globalRight() : GlobalVector::Zero();
  std::vector<Vector6d>& kept_step = cameras_go_ ? step->marker : step->camera;
  std::vector<Vector6d>& gone_step = cameras_go_ ? step->camera : step->marker;
  kept_step.assign(position_.size(), Vector6d::Zero());
  gone_step.assign(goes_.size(), Vector6d::Zero());
  for (std::size_t i = 0; i < position_.size(); ++i) {
    if (position_[i] >= 0) kept_step[i] = reduced_.right(position_[i]);
  }
  for (std::size_t e = 0; e < goes_.size(); ++e) {
    const std::size_t n = first_view_[e + 1] - first_view_[e];
    co_await budget->spend(0.5 * kPose + 0.3 * kView * static_cast<double>(n));
    if (goes_[e]) substitute(e, problem.hasGlobals(), step->globals, &gone_step[e]);
  }
  co_return true;
}

Task<bool> SchurComplement::solveDirectly(const BundleProblem& problem,
                                          const NormalEquations& equations, double lambda,
                                          Budget* budget) {
  has_factor_ = false;
  (void)co_await reduced_.clear(budget);
  fillKept(problem, equations, lambda);
  for (std::size_t e = 0; e < goes_.size(); ++e) {
    const std::size_t n = first_view_[e + 1] - first_view_[e];
    co_await budget->spend(kPose + kView * static_cast<double>(n) + kViewPair * pairs(n));
    if (goes_[e] && !eliminate(e, problem, equations, lambda)) co_return false;
  }
  const bool solved = co_await reduced_.solve(budget);
  has_factor_ = solved && !problem.hasGlobals() && reduced_.poses() >= kFewPoses;
  co_return solved;
}

Task<bool> SchurComplement::solveIteratively(const BundleProblem& problem,
                                             const NormalEquations& equations, double lambda,
                                             Budget* budget) {
  const auto& H = cameras_go_ ? equations.H_marker : equations.H_camera;
  const auto& g = cameras_go_ ? equations.g_marker : equations.g_camera;
  const std::size_t n = at(reduced_.poses());
  co_await budget->spend(kPose * static_cast<double>(n));
  std::vector<Matrix6d> diagonal(n);
  std::vector<Vector6d> residual(n);
  for (std::size_t i = 0; i < position_.size(); ++i) {
    if (position_[i] < 0) continue;
    diagonal[at(position_[i])] = damped(H[i], lambda);
    residual[at(position_[i])] = -g[i];
  }
  for (std::size_t e = 0; e < goes_.size(); ++e) {
    const std::size_t views = first_view_[e + 1] - first_view_[e];
    co_await budget->spend(kPose + kView * static_cast<double>(views));
    if (!goes_[e]) continue;
    if (!factorize(e, problem, equations, lambda)) co_return false;
    for (std::size_t v = first_view_[e]; v < first_view_[e + 1]; ++v) {
      residual[at(views_[v].position)].noalias() += Z_[v] * right_[e];
    }
  }
  co_return co_await conjugateGradients(diagonal, std::move(residual), budget);
}

Task<bool> SchurComplement::conjugateGradients(const std::vector<Matrix6d>& diagonal,
                                               std::vector<Vector6d> residual, Budget* budget) {
  const std::size_t n = residual.size();
  const double vectors = kMoveVector * static_cast<double>(n);
  std::vector<Vector6d> x(n, Vector6d::Zero());
  std::vector<Vector6d> direction(n, Vector6d::Zero());
  std::vector<Vector6d> product(n);
  double before = 0.0;
  double alpha = 0.0;
  double decrease = 0.0;
  for (int i = 0; i < kMostIterations; ++i) {
    for (std::size_t k = 0; k < n; ++k) reduced_.right(static_cast<int>(k)) = residual[k];
    if (!co_await reduced_.solveAgain(budget)) co_return false;
    co_await budget->spend(4.0 * vectors);
    double now = 0.0;
    for (std::size_t k = 0; k < n; ++k) now += residual[k].dot(reduced_.right(static_cast<int>(k)));
    const double enough = std::clamp(kLeftOfDecrease * decrease, kLeastLeft, kMostLeft);
    if (i > 0 && alpha * now <= enough) {
      for (std::size_t k = 0; k < n; ++k) reduced_.right(static_cast<int>(k)) = x[k];
      co_return true;
    }
    const double beta = i == 0 ? 0.0 : now / before;
    before = now;
    for (std::size_t k = 0; k < n; ++k) {
      direction[k] = reduced_.right(static_cast<int>(k)) + beta * direction[k];
    }
    (void)co_await multiply(diagonal, direction, &product, budget);
    double curvature = 0.0;
    for (std::size_t k = 0; k < n; ++k) curvature += direction[k].dot(product[k]);
    if (!(curvature > 0.0)) co_return false;
    alpha = now / curvature;
    decrease += alpha * now;
    for (std::size_t k = 0; k < n; ++k) {
      x[k] += alpha * direction[k];
      residual[k] -= alpha * product[k];
    }
  }
  co_return false;
}

Task<Done> SchurComplement::multiply(const std::vector<Matrix6d>& diagonal,
                                     const std::vector<Vector6d>& x, std::vector<Vector6d>* result,
                                     Budget* budget) const {
  co_await budget->spend(kMultiplyView * static_cast<double>(x.size()));
  for (std::size_t k = 0; k < x.size(); ++k) (*result)[k].noalias() = diagonal[k] * x[k];
  for (std::size_t e = 0; e < goes_.size(); ++e) {
    const std::size_t begin = first_view_[e];
    const std::size_t end = first_view_[e + 1];
    co_await budget->spend(kMultiplyView * static_cast<double>(end - begin));
    Vector6d gone = Vector6d::Zero();
    for (std::size_t v = begin; v < end; ++v) {
      gone.noalias() += Z_[v].transpose() * x[at(views_[v].position)];
    }
    for (std::size_t v = begin; v < end; ++v) {
      (*result)[at(views_[v].position)].noalias() -= Z_[v] * gone;
    }
  }
  co_return Done{};
}

void SchurComplement::fillKept(const BundleProblem& problem, const NormalEquations& equations,
                               double lambda) {
  const auto& H = cameras_go_ ? equations.H_marker : equations.H_camera;
  const auto& g = cameras_go_ ? equations.g_marker : equations.g_camera;
  const auto& H_global = cameras_go_ ? equations.H_marker_global : equations.H_camera_global;
  for (std::size_t i = 0; i < position_.size(); ++i) {
    const int position = position_[i];
    if (position < 0) continue;
    reduced_.diagonal(position) = damped(H[i], lambda);
    reduced_.right(position) = -g[i];
    if (problem.hasGlobals()) reduced_.globalBlock(position) = H_global[i];
  }
  if (!problem.hasGlobals()) return;
  reduced_.globals() = equations.H_global;
  reduced_.globals().diagonal() *= 1.0 + lambda;
  reduced_.globalRight() = -equations.g_global;
}

bool SchurComplement::factorize(std::size_t gone, const BundleProblem& problem,
                                const NormalEquations& equations, double lambda) {
  Matrix6d& L = factor_[gone];
  L = damped(cameras_go_ ? equations.H_camera[gone] : equations.H_marker[gone], lambda);
  if (!factorizeCholesky(&L)) return false;
  Vector6d& right = right_[gone];
  right = cameras_go_ ? equations.g_camera[gone] : equations.g_marker[gone];
  solveLower(L, &right);
  if (problem.hasGlobals()) {
    PoseGlobalMatrix& G = global_[gone];
    G = cameras_go_ ? equations.H_camera_global[gone] : equations.H_marker_global[gone];
    solveLower(L, &G);
  }
  for (std::size_t v = first_view_[gone]; v < first_view_[gone + 1]; ++v) {
    const Matrix6d& cross = equations.H_cross[views_[v].tie];
    Z_[v] = cameras_go_ ? Matrix6d(cross.transpose()) : cross;
    divideByTransposed(L, &Z_[v]);
  }
  return true;
}

bool SchurComplement::eliminate(std::size_t gone, const BundleProblem& problem,
                                const NormalEquations& equations, double lambda) {
  if (!factorize(gone, problem, equations, lambda)) return false;
  const Vector6d& right = right_[gone];
  const std::size_t end = first_view_[gone + 1];
  for (std::size_t v = first_view_[gone]; v < end; ++v) {
    reduced_.right(views_[v].position).noalias() += Z_[v] * right;
  }
  if (problem.hasGlobals()) {
    const PoseGlobalMatrix& G = global_[gone];
    reduced_.globals().noalias() -= G.transpose() * G;
    reduced_.globalRight().noalias() += G.transpose() * right;
    for (std::size_t v = first_view_[gone]; v < end; ++v) {
      reduced_.globalBlock(views_[v].position).noalias() -= Z_[v] * G;
    }
  }
  const std::size_t* place = places_.data() + first_place_[gone];
  for (std::size_t b = first_view_[gone]; b < end; ++b) {
    for (std::size_t a = b; a < end; ++a) {
      subtractProduct(Z_[a], Z_[b], &reduced_.block(*place++));
    }
  }
  return true;
}

void SchurComplement::substitute(std::size_t gone, bool with_globals, const GlobalVector& globals,
                                 Vector6d* step) {
  Vector6d x = -right_[gone];
  for (std::size_t v = first_view_[gone]; v < first_view_[gone + 1]; ++v) {
    x.noalias() -= Z_[v].transpose() * reduced_.right(views_[v].position);
  }
  if (with_globals) x.noalias() -= global_[gone] * globals;
  solveLowerTransposed(factor_[gone], &x);
  *step = x;
}

std::optional<GlobalMatrix> SchurComplement::globalsCovariance(const BundleProblem& problem) const {
  return problem.hasGlobals() ? reduced_.globalsCovariance() : std::nullopt;
}

}  // namespace waymark::slam
