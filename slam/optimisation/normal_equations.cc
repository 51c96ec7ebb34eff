#include "slam/optimisation/normal_equations.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "slam/geometry/robust.h"
#include "slam/optimisation/reduced_system.h"

namespace waymark::slam {
namespace {

std::size_t at(int index) { return static_cast<std::size_t>(index); }

// One corner's residual, and its derivatives by everything it depends on.
struct CornerTerm {
  Eigen::Vector2d residual;  // whitened
  Matrix26d J_camera, J_marker;
  Eigen::Matrix<double, 2, BundleProblem::kGlobals> J_global;
};

// The corner as the camera saw it at the middle row's time, given the readout time as it is now.
Eigen::Vector2d seenAt(const BundleProblem& problem, std::size_t o, std::size_t k) {
  const Eigen::Vector2d& seen = problem.observations[o].detection->normalised[k];
  if (!problem.shutter) return seen;
  const double longer_s = problem.shutter->readout_s - problem.shutter->corrected_with_s;
  return seen - longer_s * problem.shutter->motion[o][k];
}

// False when the corner is behind its camera.
bool project(const BundleProblem& problem, std::size_t o, std::size_t k, const Eigen::Matrix2d& W,
             const Eigen::Vector3d& p_w, Projection* projection, CornerTerm* term) {
  const auto& observation = problem.observations[o];
  const Transform& T_w_c = problem.cameras[at(observation.camera)].T;
  if (!projectPoint(T_w_c, p_w, projection)) return false;
  const Eigen::Vector2d seen = seenAt(problem, o, k);
  const Eigen::Vector2d error =
      problem.lens ? Eigen::Vector2d(problem.lens->camera.distort(projection->normalised) -
                                     problem.lens->seen_with.distort(seen))
                   : Eigen::Vector2d(projection->normalised - seen);
  term->residual = W * error;
  return true;
}

void differentiate(const BundleProblem& problem, std::size_t o, std::size_t k,
                   const Eigen::Matrix2d& W, const Eigen::Vector3d& p_w,
                   const Projection& projection, CornerTerm* term) {
  const auto& observation = problem.observations[o];
  Matrix23d J_point = W * projection.J_point;
  if (problem.hasGlobals()) term->J_global.setZero();
  if (problem.lens) {
    const CameraModel& camera = problem.lens->camera;
    Eigen::Matrix2d J_distortion;
    (void)camera.distort(projection.normalised, &J_distortion);
    J_point = W * J_distortion * projection.J_point;
    term->J_global.leftCols<9>() = W * camera.intrinsicJacobian(projection.normalised);
  }
  if (problem.shutter) {
    Eigen::Matrix2d J_seen = Eigen::Matrix2d::Identity();
    if (problem.lens) (void)problem.lens->seen_with.distort(seenAt(problem, o, k), &J_seen);
    term->J_global.rightCols<1>() = W * J_seen * problem.shutter->motion[o][k];
  }
  term->J_camera = cameraJacobian(problem.cameras[at(observation.camera)].T, p_w, J_point);
  term->J_marker = markerJacobian(problem.markers[at(observation.marker)].T, p_w, J_point);
}

// Calls `use(observation, projected corner, term)` for every corner, without derivatives; false
// when one is behind its camera.
template <typename Use>
bool forEachCorner(const BundleProblem& problem, const std::vector<WhitenedCorners>& whitened,
                   const Use& use) {
  CornerTerm term;
  Projection projection;
  for (std::size_t o = 0; o < problem.observations.size(); ++o) {
    const std::size_t m = at(problem.observations[o].marker);
    const auto corners = markerCorners(problem.marker_sizes_m[m]);
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d p_w = problem.markers[m].T * corners[k];
      if (!project(problem, o, k, whitened[o][k], p_w, &projection, &term)) return false;
      use(o, k, p_w, projection, &term);
    }
  }
  return true;
}

Vector6d priorError(const BundleProblem& problem, const BundleProblem::Prior& prior) {
  return prior.T_w_m.localCoordinates(problem.markers[at(prior.marker)].T);
}

// 1 / sigma^2 of each global; a fixed one gets a weight no data outvotes.
GlobalVector globalInformation(const BundleProblem& problem) {
  constexpr double kFixed = 1e16;
  GlobalVector sigma = GlobalVector::Zero();
  if (problem.lens) sigma.head<9>() = problem.lens->sigma;
  if (problem.shutter) sigma[9] = problem.shutter->sigma_s;
  GlobalVector information;
  for (Eigen::Index i = 0; i < information.size(); ++i) {
    information[i] = sigma[i] > 0.0 ? std::min(1.0 / (sigma[i] * sigma[i]), kFixed) : kFixed;
  }
  return information;
}

// How far the globals are from what was expected of them.
GlobalVector globalError(const BundleProblem& problem) {
  GlobalVector error = GlobalVector::Zero();
  if (problem.lens) error.head<9>() = problem.lens->camera.intrinsics() - problem.lens->expected;
  if (problem.shutter) {
    error[9] = problem.shutter->readout_s - problem.shutter->corrected_with_s;
  }
  return error;
}

double priorCost(const BundleProblem& problem) {
  double cost = 0.0;
  for (const auto& prior : problem.priors) {
    const Vector6d e = priorError(problem, prior);
    cost += e.dot(prior.information * e);
  }
  if (problem.hasGlobals()) {
    const GlobalVector e = globalError(problem);
    cost += e.dot(globalInformation(problem).asDiagonal() * e);
  }
  return cost;
}

void addPriors(const BundleProblem& problem, NormalEquations* equations) {
  for (const auto& prior : problem.priors) {
    // To first order d localCoordinates = d delta: the estimate stays near a surveyed pose.
    equations->H_marker[at(prior.marker)] += prior.information;
    equations->g_marker[at(prior.marker)] += prior.information * priorError(problem, prior);
  }
  if (problem.hasGlobals()) {
    const GlobalVector information = globalInformation(problem);
    equations->H_global.diagonal() += information;
    equations->g_global += information.cwiseProduct(globalError(problem));
  }
}

void reset(const BundleProblem& problem, NormalEquations* equations) {
  equations->H_camera.assign(problem.cameras.size(), Matrix6d::Zero());
  equations->g_camera.assign(problem.cameras.size(), Vector6d::Zero());
  equations->H_marker.assign(problem.markers.size(), Matrix6d::Zero());
  equations->g_marker.assign(problem.markers.size(), Vector6d::Zero());
  equations->H_cross.assign(problem.observations.size(), Matrix6d::Zero());
  if (problem.hasGlobals()) {
    equations->H_camera_global.assign(problem.cameras.size(), PoseGlobalMatrix::Zero());
    equations->H_marker_global.assign(problem.markers.size(), PoseGlobalMatrix::Zero());
  }
  equations->H_global.setZero();
  equations->g_global.setZero();
  equations->cost = 0.0;
}

// One side of the bipartite problem as the Schur complement sees it.
struct Group {
  const std::vector<BundleProblem::Pose>* poses;
  const std::vector<Matrix6d>* H;
  const std::vector<Vector6d>* g;
  const std::vector<PoseGlobalMatrix>* H_global;
};

Matrix6d damped(const Matrix6d& H, double lambda) {
  Matrix6d result = H;
  result.diagonal() *= 1.0 + lambda;
  result.diagonal().array() += 1e-12;
  return result;
}

// The elimination of one group from the equations.
class Elimination {
 public:
  Elimination(const BundleProblem& problem, const NormalEquations& equations, double lambda)
      : problem_(problem),
        equations_(equations),
        lambda_(lambda),
        cameras_go_(problem.cameras.size() >= problem.markers.size()),
        cameras_{&problem.cameras, &equations.H_camera, &equations.g_camera,
                 &equations.H_camera_global},
        markers_{&problem.markers, &equations.H_marker, &equations.g_marker,
                 &equations.H_marker_global},
        gone_(cameras_go_ ? cameras_ : markers_),
        kept_(cameras_go_ ? markers_ : cameras_),
        seen_(gone_.poses->size()),
        inverse_(gone_.poses->size(), Matrix6d::Zero()),
        kept_index_(kept_.poses->size(), -1) {
    for (std::size_t o = 0; o < problem.observations.size(); ++o) seen_[goneOf(o)].push_back(o);
    for (std::size_t i = 0; i < kept_.poses->size(); ++i) {
      if (!(*kept_.poses)[i].fixed) kept_index_[i] = kept_count_++;
    }
  }

  bool solve(BundleStep* step) {
    ReducedSystem reduced(kept_count_, problem_.hasGlobals());
    reduce(&reduced);
    const std::optional<Eigen::VectorXd> x = reduced.solve();
    if (!x) return false;
    if (problem_.hasGlobals()) step->globals = x->tail<BundleProblem::kGlobals>();
    substitute(*x, step);
    return true;
  }

  std::optional<double> lastVariance() {
    ReducedSystem reduced(kept_count_, problem_.hasGlobals());
    reduce(&reduced);
    return reduced.lastVariance();
  }

 private:
  [[nodiscard]] std::size_t goneOf(std::size_t o) const {
    const auto& observation = problem_.observations[o];
    return at(cameras_go_ ? observation.camera : observation.marker);
  }
  [[nodiscard]] std::size_t keptOf(std::size_t o) const {
    const auto& observation = problem_.observations[o];
    return at(cameras_go_ ? observation.marker : observation.camera);
  }
  // Rows: the eliminated pose; columns: the kept one.
  [[nodiscard]] Matrix6d crossOf(std::size_t o) const {
    return cameras_go_ ? equations_.H_cross[o] : Matrix6d(equations_.H_cross[o].transpose());
  }
  [[nodiscard]] bool eliminated(std::size_t e) const {
    return !(*gone_.poses)[e].fixed && !seen_[e].empty();
  }

  void reduce(ReducedSystem* reduced) {
    for (std::size_t i = 0; i < kept_.poses->size(); ++i) {
      if (kept_index_[i] < 0) continue;
      reduced->addBlock(kept_index_[i], kept_index_[i], damped((*kept_.H)[i], lambda_));
      reduced->addRight(kept_index_[i], -(*kept_.g)[i]);
      if (problem_.hasGlobals()) reduced->addGlobalBlock(kept_index_[i], (*kept_.H_global)[i]);
    }
    if (problem_.hasGlobals()) {
      GlobalMatrix H = equations_.H_global;
      H.diagonal() *= 1.0 + lambda_;
      reduced->addGlobals(H, -equations_.g_global);
    }
    for (std::size_t e = 0; e < gone_.poses->size(); ++e) {
      if (eliminated(e)) eliminate(e, reduced);
    }
  }

  void eliminate(std::size_t e, ReducedSystem* reduced) {
    inverse_[e] = damped((*gone_.H)[e], lambda_).ldlt().solve(Matrix6d::Identity());
    for (const std::size_t o1 : seen_[e]) {
      const int i = kept_index_[keptOf(o1)];
      if (i < 0) continue;
      const Matrix6d WtHinv = crossOf(o1).transpose() * inverse_[e];
      reduced->addRight(i, WtHinv * (*gone_.g)[e]);
      if (problem_.hasGlobals()) reduced->addGlobalBlock(i, -(WtHinv * (*gone_.H_global)[e]));
      for (const std::size_t o2 : seen_[e]) {
        const int j = kept_index_[keptOf(o2)];
        if (j >= 0 && j <= i) reduced->addBlock(i, j, -(WtHinv * crossOf(o2)));
      }
    }
    if (problem_.hasGlobals()) {
      const PoseGlobalMatrix HinvG = inverse_[e] * (*gone_.H_global)[e];
      reduced->addGlobals(-((*gone_.H_global)[e].transpose() * HinvG),
                          HinvG.transpose() * (*gone_.g)[e]);
    }
  }

  void substitute(const Eigen::VectorXd& x, BundleStep* step) const {
    std::vector<Vector6d>& kept_step = cameras_go_ ? step->marker : step->camera;
    std::vector<Vector6d>& gone_step = cameras_go_ ? step->camera : step->marker;
    kept_step.assign(kept_.poses->size(), Vector6d::Zero());
    gone_step.assign(gone_.poses->size(), Vector6d::Zero());
    for (std::size_t i = 0; i < kept_.poses->size(); ++i) {
      if (kept_index_[i] >= 0) kept_step[i] = x.segment<6>(6 * kept_index_[i]);
    }
    for (std::size_t e = 0; e < gone_.poses->size(); ++e) {
      if (!eliminated(e)) continue;
      Vector6d rhs = -(*gone_.g)[e];
      for (const std::size_t o : seen_[e]) rhs -= crossOf(o) * kept_step[keptOf(o)];
      if (problem_.hasGlobals()) rhs -= (*gone_.H_global)[e] * step->globals;
      gone_step[e] = inverse_[e] * rhs;
    }
  }

  const BundleProblem& problem_;
  const NormalEquations& equations_;
  double lambda_;
  bool cameras_go_;
  Group cameras_, markers_;
  const Group& gone_;
  const Group& kept_;
  std::vector<std::vector<std::size_t>> seen_;  // observations of each eliminated pose
  std::vector<Matrix6d> inverse_;               // of each eliminated pose's damped block
  std::vector<int> kept_index_;                 // in the reduced system; -1 for fixed poses
  int kept_count_ = 0;
};

}  // namespace

std::vector<WhitenedCorners> whitenCorners(const BundleProblem& problem) {
  std::vector<WhitenedCorners> whitened;
  whitened.reserve(problem.observations.size());
  for (const auto& observation : problem.observations) {
    WhitenedCorners corners;
    for (std::size_t k = 0; k < 4; ++k) {
      Eigen::Matrix2d covariance = observation.detection->covariance[k];
      if (problem.lens) {
        Eigen::Matrix2d J;
        (void)problem.lens->seen_with.distort(observation.detection->normalised[k], &J);
        covariance = J * covariance * J.transpose();
      }
      corners[k] = whitening(covariance);
    }
    whitened.push_back(corners);
  }
  return whitened;
}

bool robustCost(const BundleProblem& problem, const std::vector<WhitenedCorners>& whitened,
                double huber, double* cost) {
  *cost = priorCost(problem);
  return forEachCorner(
      problem, whitened,
      [&](std::size_t, std::size_t, const Eigen::Vector3d&, const Projection&,
          const CornerTerm* term) { *cost += huberCost(term->residual.squaredNorm(), huber); });
}

bool cornerErrors(const BundleProblem& problem, const std::vector<WhitenedCorners>& whitened,
                  std::vector<double>* squared) {
  squared->clear();
  squared->reserve(4 * problem.observations.size());
  return forEachCorner(
      problem, whitened,
      [&](std::size_t, std::size_t, const Eigen::Vector3d&, const Projection&,
          const CornerTerm* term) { squared->push_back(term->residual.squaredNorm()); });
}

bool linearise(const BundleProblem& problem, const std::vector<WhitenedCorners>& whitened,
               double huber, NormalEquations* equations) {
  reset(problem, equations);
  const auto add = [&](std::size_t o, std::size_t k, const Eigen::Vector3d& p_w,
                       const Projection& projection, CornerTerm* term) {
    const auto& observation = problem.observations[o];
    const std::size_t c = at(observation.camera);
    const std::size_t m = at(observation.marker);
    differentiate(problem, o, k, whitened[o][k], p_w, projection, term);
    const double squared = term->residual.squaredNorm();
    const double weight = huberWeight(squared, huber);
    const Matrix26d wJ_c = weight * term->J_camera;
    const Matrix26d wJ_m = weight * term->J_marker;
    equations->cost += huberCost(squared, huber);
    equations->H_camera[c].noalias() += wJ_c.transpose() * term->J_camera;
    equations->g_camera[c].noalias() += wJ_c.transpose() * term->residual;
    equations->H_marker[m].noalias() += wJ_m.transpose() * term->J_marker;
    equations->g_marker[m].noalias() += wJ_m.transpose() * term->residual;
    equations->H_cross[o].noalias() += wJ_c.transpose() * term->J_marker;
    if (!problem.hasGlobals()) return;
    equations->H_camera_global[c].noalias() += wJ_c.transpose() * term->J_global;
    equations->H_marker_global[m].noalias() += wJ_m.transpose() * term->J_global;
    equations->H_global.noalias() += weight * term->J_global.transpose() * term->J_global;
    equations->g_global.noalias() += weight * term->J_global.transpose() * term->residual;
  };
  if (!forEachCorner(problem, whitened, add)) return false;
  equations->cost += priorCost(problem);
  addPriors(problem, equations);
  return true;
}

bool solveStep(const BundleProblem& problem, const NormalEquations& equations, double lambda,
               BundleStep* step) {
  return Elimination(problem, equations, lambda).solve(step);
}

std::optional<double> readoutVariance(const BundleProblem& problem,
                                      const NormalEquations& equations) {
  if (!problem.shutter) return std::nullopt;
  return Elimination(problem, equations, 0.0).lastVariance();
}

}  // namespace waymark::slam
