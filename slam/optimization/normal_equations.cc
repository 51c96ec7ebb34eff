#include "slam/optimization/normal_equations.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include <Eigen/Cholesky>

#include "slam/geometry/robust.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/optimization/block_kernels.h"
#include "slam/optimization/marker_relation.h"

namespace waymark::slam {
namespace {

std::size_t at(int index) { return static_cast<std::size_t>(index); }

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kWhiten = 0.05;     // an observation
constexpr double kResiduals = 0.06;  // of an observation
constexpr double kLinearize = 0.35;
constexpr double kDifferentiateByGlobals = 0.5;
constexpr double kResetPose = 0.035;
constexpr double kRelate = 0.3;          // a constraint
constexpr double kRelationsCost = 0.05;  // of one

// An observation's residuals (two by corner), and their derivatives by its marker's pose and by the
// globals; those by the camera's follow from the marker's.
struct ObservationTerm {
  Eigen::Matrix<double, 8, 1> residual;  // whitened
  Eigen::Matrix<double, 8, 6> J_marker;
  Eigen::Matrix<double, 8, BundleProblem::kGlobals> J_global;
};

// The corner as the camera saw it at the middle row's time, given the readout time as it is now.
Eigen::Vector2d seenAt(const BundleProblem& problem, std::size_t o, std::size_t k,
                       const WhitenedView& view) {
  if (!problem.shutter) return view.seen[k];
  const double longer_s = problem.shutter->readout_s - problem.shutter->corrected_with_s;
  return view.seen[k] - longer_s * problem.shutter->motion[o][k];
}

// Whitened. The projection must be in front of the camera.
Eigen::Vector2d residualOf(const BundleProblem& problem, std::size_t o, std::size_t k,
                           const WhitenedView& view, const Eigen::Vector2d& projected) {
  const Eigen::Vector2d seen = seenAt(problem, o, k, view);
  const Eigen::Matrix2d& W = view.W[k];
  if (!problem.lens) return W * (projected - seen);
  return W * (problem.lens->camera.distort(projected) - problem.lens->seen_with.distort(seen));
}

void differentiateByGlobals(const BundleProblem& problem, std::size_t o, std::size_t k,
                            const Eigen::Matrix2d& W, const WhitenedView& view,
                            const Eigen::Vector2d& projected, ObservationTerm* term) {
  const auto row = static_cast<Eigen::Index>(2 * k);
  auto J = term->J_global.middleRows<2>(row);
  J.setZero();
  if (problem.lens) J.leftCols<9>() = W * problem.lens->camera.intrinsicJacobian(projected);
  if (!problem.shutter) return;
  Eigen::Matrix2d J_seen = Eigen::Matrix2d::Identity();
  if (problem.lens) (void)problem.lens->seen_with.distort(seenAt(problem, o, k, view), &J_seen);
  J.rightCols<1>() = W * J_seen * problem.shutter->motion[o][k];
}

// Its corners in the camera's frame; false when one is behind it.
bool cornersInCamera(const BundleProblem& problem, std::size_t o,
                     std::array<Eigen::Vector3d, 4>* corners_c) {
  const auto& observation = problem.observations[o];
  const Transform& T_w_c = problem.cameras[at(observation.camera)].T;
  const Transform& T_w_m = problem.markers[at(observation.marker)].T;
  const double half = 0.5 * problem.marker_sizes_m[at(observation.marker)];
  // Corners are centre and half the sides to the right and up.
  const Eigen::Vector3d centre = T_w_c.R.transpose() * (T_w_m.p - T_w_c.p);
  const Eigen::Vector3d right = T_w_c.R.transpose() * (half * T_w_m.R.col(0));
  const Eigen::Vector3d up = T_w_c.R.transpose() * (half * T_w_m.R.col(1));
  *corners_c = {centre - right + up, centre + right + up, centre + right - up, centre - right - up};
  return std::ranges::all_of(*corners_c,
                             [](const Eigen::Vector3d& p) { return p.z() >= kNearestDepth; });
}

// Calls `use(corner's squared norm)` for every corner; false when one is behind its camera.
template <typename Use>
bool squaredErrors(const BundleProblem& problem, std::size_t o, const WhitenedView& view,
                   const Use& use) {
  std::array<Eigen::Vector3d, 4> corners_c;
  if (!cornersInCamera(problem, o, &corners_c)) return false;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector2d projected = corners_c[k].head<2>() / corners_c[k].z();
    use(residualOf(problem, o, k, view, projected).squaredNorm());
  }
  return true;
}

// Weighted with the kernel's; adds to the cost.
bool differentiate(const BundleProblem& problem, std::size_t o, const WhitenedView& view,
                   double huber, ObservationTerm* term, double* cost) {
  const auto& observation = problem.observations[o];
  const Transform& T_w_c = problem.cameras[at(observation.camera)].T;
  const Transform& T_w_m = problem.markers[at(observation.marker)].T;
  std::array<Eigen::Vector3d, 4> corners_c;
  if (!cornersInCamera(problem, o, &corners_c)) return false;
  const auto corners_m = markerCorners(problem.marker_sizes_m[at(observation.marker)]);
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector2d projected = corners_c[k].head<2>() / corners_c[k].z();
    const Eigen::Vector2d residual = residualOf(problem, o, k, view, projected);
    const double squared = residual.squaredNorm();
    *cost += huberCost(squared, huber);
    const double root = std::sqrt(huberWeight(squared, huber));
    const Eigen::Matrix2d W = root * view.W[k];
    Matrix23d J_point = projectionJacobian(T_w_c, corners_c[k]);
    if (problem.lens) {
      Eigen::Matrix2d J_distortion;
      (void)problem.lens->camera.distort(projected, &J_distortion);
      J_point = (J_distortion * J_point).eval();
    }
    J_point = (W * J_point).eval();
    const auto row = static_cast<Eigen::Index>(2 * k);
    const Eigen::Vector3d arm = T_w_m.R.leftCols<2>() * corners_m[k].head<2>();
    term->residual.segment<2>(row) = root * residual;
    // -J_point * skew(arm), row by row.
    for (Eigen::Index i = 0; i < 2; ++i) {
      const Eigen::Vector3d j = J_point.row(i);
      term->J_marker.row(row + i) << j.transpose(), arm.cross(j).transpose();
    }
    if (problem.hasGlobals()) differentiateByGlobals(problem, o, k, W, view, projected, term);
  }
  return true;
}

// To the marker of a tie, from its camera.
Eigen::Vector3d fromCamera(const BundleProblem& problem, const BundleProblem::Tie& tie) {
  return problem.markers[at(tie.marker)].T.p - problem.cameras[at(tie.camera)].T.p;
}

// What a tie says of its marker, the camera held: H, and the gradient g. Of the camera it says the
// same the other way round: J_camera = -J_marker K, with the K of transposedTransport.
void addTie(const BundleProblem& problem, std::size_t index, const Matrix6d& H, const Vector6d& g,
            NormalEquations* equations) {
  const BundleProblem::Tie tie = problem.tie(index);
  const Eigen::Vector3d d = fromCamera(problem, tie);
  const Matrix6d KtH = transposedTransport<6>(d, H);
  equations->H_marker[at(tie.marker)] += H;
  equations->g_marker[at(tie.marker)] += g;
  equations->H_camera[at(tie.camera)] += transposedTransport<6>(d, KtH.transpose());
  equations->g_camera[at(tie.camera)] -= transposedTransport<1>(d, g);
  equations->H_cross[index] = -KtH;
}

void accumulate(const BundleProblem& problem, std::size_t o, const ObservationTerm& term,
                NormalEquations* equations) {
  Matrix6d H;
  for (int j = 0; j < 6; ++j) {
    for (int i = j; i < 6; ++i) {
      H(i, j) = H(j, i) = term.J_marker.col(i).dot(term.J_marker.col(j));
    }
  }
  Vector6d g;
  for (int i = 0; i < 6; ++i) g[i] = term.J_marker.col(i).dot(term.residual);
  addTie(problem, o, H, g, equations);
  if (!problem.hasGlobals()) return;
  const BundleProblem::Tie tie = problem.tie(o);
  // Row by row of few columns: lazy products are made without the packing that large ones are
  // worth.
  const PoseGlobalMatrix G = term.J_marker.transpose().lazyProduct(term.J_global);
  equations->H_marker_global[at(tie.marker)] += G;
  equations->H_camera_global[at(tie.camera)] -=
      transposedTransport<BundleProblem::kGlobals>(fromCamera(problem, tie), G);
  equations->H_global += term.J_global.transpose().lazyProduct(term.J_global);
  equations->g_global += term.J_global.transpose().lazyProduct(term.residual);
}

// Of (dp, dtheta) of the marker's pose, in the world: where it is less where the camera has it.
Vector6d linkError(const BundleProblem& problem, const BundleProblem::Link& link) {
  const Transform& T_w_c = problem.cameras[at(link.camera)].T;
  return (T_w_c * link.T_c_m).localCoordinates(problem.markers[at(link.marker)].T);
}

Matrix6d informationInWorld(const BundleProblem& problem, const BundleProblem::Link& link) {
  return turnedCovariance(problem.cameras[at(link.camera)].T.R, link.information);
}

// To first order in the error, which is what the marker moves by.
void addLinks(const BundleProblem& problem, NormalEquations* equations) {
  for (std::size_t l = 0; l < problem.links.size(); ++l) {
    const BundleProblem::Link& link = problem.links[l];
    const Matrix6d H = informationInWorld(problem, link);
    addTie(problem, problem.observations.size() + l, H, H * linkError(problem, link), equations);
  }
}

// What frames say of the markers, and where they are themselves.
Task<Done> addConstraints(const BundleProblem& problem, double huber, NormalEquations* equations,
                          Budget* budget) {
  const std::size_t first = problem.observations.size() + problem.links.size();
  for (std::size_t i = 0; i < problem.constraints.size(); ++i) {
    co_await budget->spend(kRelate);
    const BundleProblem::Constraint& constraint = problem.constraints[i];
    const RelationSums sums =
        sumRelations(constraint.relations, problem.cameras[at(constraint.camera)].T,
                     problem.markers[at(constraint.marker)].T, huber);
    addTie(problem, first + i, sums.H, sums.g, equations);
    equations->cost += sums.cost;
  }
  for (const BundleProblem::Gauge& gauge : problem.gauges) {
    equations->H_camera[at(gauge.camera)] +=
        turnedCovariance(problem.cameras[at(gauge.camera)].T.R, gauge.information.asDiagonal());
  }
  co_return Done{};
}

Task<double> constraintCost(const BundleProblem& problem, double huber, Budget* budget) {
  double cost = 0.0;
  for (const BundleProblem::Constraint& constraint : problem.constraints) {
    co_await budget->spend(kRelationsCost);
    cost += relationCost(constraint.relations, problem.cameras[at(constraint.camera)].T,
                         problem.markers[at(constraint.marker)].T, huber);
  }
  co_return cost;
}

Vector6d priorError(const BundleProblem& problem, const BundleProblem::Prior& prior) {
  return prior.T_w_m.localCoordinates(problem.markers[at(prior.marker)].T);
}

GlobalMatrix globalInformation(const BundleProblem& problem) {
  GlobalMatrix information = kExactInformation * GlobalMatrix::Identity();
  if (problem.lens) {
    information.topLeftCorner<9, 9>() = informationOf(problem.lens->covariance);
  }
  if (problem.shutter && problem.shutter->sigma_s > 0.0) {
    const double sigma_s = problem.shutter->sigma_s;
    information(9, 9) = std::min(1.0 / (sigma_s * sigma_s), kExactInformation);
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
  for (const auto& link : problem.links) {
    const Vector6d e = linkError(problem, link);
    cost += e.dot(informationInWorld(problem, link) * e);
  }
  if (problem.hasGlobals()) {
    const GlobalVector e = globalError(problem);
    cost += e.dot(globalInformation(problem) * e);
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
    const GlobalMatrix information = globalInformation(problem);
    equations->H_global += information;
    equations->g_global += information * globalError(problem);
  }
}

void reset(const BundleProblem& problem, NormalEquations* equations) {
  equations->H_camera.assign(problem.cameras.size(), Matrix6d::Zero());
  equations->g_camera.assign(problem.cameras.size(), Vector6d::Zero());
  equations->H_marker.assign(problem.markers.size(), Matrix6d::Zero());
  equations->g_marker.assign(problem.markers.size(), Vector6d::Zero());
  equations->H_cross.resize(problem.ties());  // each is set as a whole
  if (problem.hasGlobals()) {
    equations->H_camera_global.assign(problem.cameras.size(), PoseGlobalMatrix::Zero());
    equations->H_marker_global.assign(problem.markers.size(), PoseGlobalMatrix::Zero());
  }
  equations->H_global.setZero();
  equations->g_global.setZero();
  equations->cost = 0.0;
}

}  // namespace

Task<std::vector<WhitenedView>> whitenViews(const BundleProblem& problem, Budget* budget) {
  std::vector<WhitenedView> whitened;
  whitened.reserve(problem.observations.size());
  for (const auto& observation : problem.observations) {
    co_await budget->spend(kWhiten);
    const MarkerDetection& seen = *observation.detection;
    std::array<Eigen::Matrix2d, 4> covariance = seen.covariance;
    // A readout time that is asked for is no noise.
    for (std::size_t k = 0; problem.shutter && k < 4; ++k) covariance[k] = seen.noise(k);
    for (std::size_t k = 0; problem.lens && k < 4; ++k) {
      Eigen::Matrix2d J;
      (void)problem.lens->seen_with.distort(seen.normalized[k], &J);
      covariance[k] = J * covariance[k] * J.transpose();
    }
    whitened.push_back({whitening(covariance), seen.normalized});
  }
  co_return whitened;
}

Matrix6d poseCovariance(const Matrix6d& H, double residual_sigma) {
  if (H.isZero()) return Matrix6d::Zero();
  return residual_sigma * residual_sigma * H.ldlt().solve(Matrix6d::Identity());
}

Task<bool> robustCost(const BundleProblem& problem, const std::vector<WhitenedView>& whitened,
                      double huber, double* cost, Budget* budget) {
  *cost = 0.0;
  for (std::size_t o = 0; o < problem.observations.size(); ++o) {
    co_await budget->spend(kResiduals);
    const bool seen = squaredErrors(problem, o, whitened[o],
                                    [&](double squared) { *cost += huberCost(squared, huber); });
    if (!seen) co_return false;
  }
  *cost += priorCost(problem);
  if (!problem.constraints.empty()) {
    const double of_constraints = co_await constraintCost(problem, huber, budget);
    *cost += of_constraints;
  }
  co_return true;
}

Task<bool> cornerErrors(const BundleProblem& problem, const std::vector<WhitenedView>& whitened,
                        std::vector<double>* squared, Budget* budget) {
  squared->clear();
  squared->reserve(4 * problem.observations.size());
  for (std::size_t o = 0; o < problem.observations.size(); ++o) {
    co_await budget->spend(kResiduals);
    const bool seen =
        squaredErrors(problem, o, whitened[o], [&](double error) { squared->push_back(error); });
    if (!seen) co_return false;
  }
  co_return true;
}

Task<bool> linearize(const BundleProblem& problem, const std::vector<WhitenedView>& whitened,
                     double huber, NormalEquations* equations, Budget* budget) {
  co_await budget->spend(kResetPose *
                         static_cast<double>(problem.cameras.size() + problem.markers.size()));
  reset(problem, equations);
  ObservationTerm term;
  const double price = kLinearize + (problem.hasGlobals() ? kDifferentiateByGlobals : 0.0);
  for (std::size_t o = 0; o < problem.observations.size(); ++o) {
    co_await budget->spend(price);
    if (!differentiate(problem, o, whitened[o], huber, &term, &equations->cost)) co_return false;
    accumulate(problem, o, term, equations);
  }
  equations->cost += priorCost(problem);
  addPriors(problem, equations);
  addLinks(problem, equations);
  if (!problem.constraints.empty()) {
    (void)co_await addConstraints(problem, huber, equations, budget);
  }
  co_return true;
}

}  // namespace waymark::slam
