#include "slam/covariance/constraint_information.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

#include "slam/geometry/robust.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/map/world_reference.h"
#include "slam/optimization/block_kernels.h"
#include "slam/optimization/bundle_adjuster.h"
#include "slam/optimization/marker_relation.h"

namespace waymark::slam {
namespace {

const double kHuber = BundleOptions{}.huber;  // as in the optimizations
// Of a frame that all of its markers contradict.
constexpr double kUnknown_m = 100.0;
constexpr double kUnknown_rad = 10.0;

std::size_t at(int index) { return static_cast<std::size_t>(index); }

// The block of two poses of an inverse: rows of the first.
Matrix6d blockOf(int a, int b, BlockSystem* system) {
  const int of_a = system->positionOf(a);
  const int of_b = system->positionOf(b);
  const Matrix6d& block = system->block(system->place(std::max(of_a, of_b), std::min(of_a, of_b)));
  return of_a >= of_b ? block : Matrix6d(block.transpose());
}

// The squared length of a residual of that covariance, in its standard deviations, along those axes
// that anything else says something of.
double squaredSigmas(const Eigen::Vector3d& residual, const Eigen::Matrix3d& covariance) {
  constexpr double kLeastRedundancy = 0.01;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  double sum = 0.0;
  for (Eigen::Index i = 0; i < 3; ++i) {
    const double variance = solver.eigenvalues()[i];
    if (variance < kLeastRedundancy) continue;
    const double along = solver.eigenvectors().col(i).dot(residual);
    sum += along * along / variance;
  }
  return sum;
}

}  // namespace

void ConstraintInformation::addAnchor(std::size_t index, const Anchor& anchor,
                                      const ConstrainedUnknown& marker) {
  const Vector6d off = anchor.T_w_m.localCoordinates(marker.T_w_m);
  const auto add = [&](ConstraintSource::Kind kind, Eigen::Index first, double sigma) {
    Tie tie{.marker = marker.pose, .source = static_cast<int>(sources_.size()), .counted = true};
    sources_.push_back({kind, index, anchor.id});
    tie.residual = off.segment<3>(first) / sigma;
    tie.J_marker.middleCols<3>(first) = Eigen::Matrix3d::Identity() / sigma;
    ties_.push_back(tie);
  };
  add(ConstraintSource::Kind::kAnchor, 0, anchor.sigma_m);
  add(ConstraintSource::Kind::kAnchorTurn, 3, anchor.sigma_rad);
}

void ConstraintInformation::begin(const Map& map, const MarkerOptions& options,
                                  std::span<const ConstrainedMarker> markers) {
  const ConstraintFrames known =
      constraintFrames(options.constraints, markers, isInSurvey(map, options));
  first_source_ = static_cast<int>(sources_.size());
  sources_.insert(sources_.end(), known.sources.begin(), known.sources.end());
  for (const ConstraintFrame& frame : known.frames) addFrame(frame, markers);
  for (const MeasuredDistance& distance : known.distances) addDistance(distance, markers);
  leaveOut(options.constraints.gate_sigmas);
}

// Poses of frames are numbered in appendPoses().
void ConstraintInformation::addFrame(const ConstraintFrame& frame,
                                     std::span<const ConstrainedMarker> markers) {
  const auto number = static_cast<int>(frames_.size());
  if (!frame.fixed) {
    frames_.emplace_back();
    frames_.back().gauge = turnedCovariance(frame.T_w_f.R, frame.gauge.asDiagonal());
  }
  for (const ConstraintFrame::Member& member : frame.members) {
    const Transform& T_w_m = markers[member.marker].T_w_m;
    const int marker = poses_[member.marker];
    if (!frame.fixed && marker >= 0) frames_.back().members.push_back(marker);
    const Matrix6d transport =
        transposedTransport<6>(T_w_m.p - frame.T_w_f.p, Matrix6d::Identity()).transpose();
    for (const BundleProblem::Relation& relation : member.relations) {
      Tie tie{.marker = marker,
              .other = frame.fixed ? -1 : number,
              .source = first_source_ + relation.source};
      tie.residual = relationResidual(relation, frame.T_w_f, T_w_m);
      tie.pull = huberWeight(tie.residual.squaredNorm(), kHuber);
      tie.J_marker = relationJacobian(relation, frame.T_w_f, T_w_m);
      tie.J_other = -tie.J_marker * transport;
      ties_.push_back(tie);
    }
  }
}

// Along the line between the corners.
void ConstraintInformation::addDistance(const MeasuredDistance& distance,
                                        std::span<const ConstrainedMarker> markers) {
  const Transform& T_w_a = markers[distance.a].T_w_m;
  const Transform& T_w_b = markers[distance.b].T_w_m;
  const Eigen::Vector3d difference = T_w_b * distance.in_b - T_w_a * distance.in_a;
  const double length_m = difference.norm();
  const Eigen::Vector3d along = difference / std::max(length_m, 1e-9);
  const auto jacobian = [&](const Transform& T_w_m, const Eigen::Vector3d& in_marker) {
    const Eigen::Vector3d arm = T_w_m.R * in_marker;
    Jacobian J = Jacobian::Zero();
    J.row(0) << along.transpose(), arm.cross(along).transpose();
    return Jacobian(J / distance.sigma_m);
  };
  Tie tie{.marker = poses_[distance.a],
          .other = poses_[distance.b],
          .to_frame = false,
          .source = first_source_ + distance.source};
  tie.residual.x() = (length_m - distance.distance_m) / distance.sigma_m;
  tie.pull = huberWeight(tie.residual.squaredNorm(), kHuber);
  tie.J_marker = -jacobian(T_w_a, distance.in_a);
  tie.J_other = jacobian(T_w_b, distance.in_b);
  ties_.push_back(tie);
}

void ConstraintInformation::leaveOut(double gate_sigmas) {
  std::vector<double> squared(sources_.size(), 0.0);
  for (const Tie& tie : ties_) squared[at(tie.source)] += tie.residual.squaredNorm();
  left_out_by_.assign(sources_.size(), 0.0);
  for (Tie& tie : ties_) {
    const double off = squared[at(tie.source)];
    tie.left_out = !tie.counted && off > gate_sigmas * gate_sigmas;
    if (tie.left_out) left_out_by_[at(tie.source)] = std::sqrt(off);
  }
}

void ConstraintInformation::appendPoses(std::vector<std::vector<int>>* neighbours) {
  const auto first = static_cast<int>(neighbours->size());
  for (Frame& frame : frames_) {
    frame.pose = static_cast<int>(neighbours->size());
    neighbours->push_back(frame.members);
  }
  for (Tie& tie : ties_) {
    if (tie.to_frame && tie.other >= 0) tie.other += first;
    if (!tie.to_frame && tie.marker >= 0 && tie.other >= 0) {
      (*neighbours)[at(tie.marker)].push_back(tie.other);
    }
  }
}

void ConstraintInformation::addTo(double variance, BlockSystem* system) const {
  for (const Frame& frame : frames_) {
    const Matrix6d hardly_known = independentInformation(kUnknown_m, kUnknown_rad);
    system->diagonal(system->positionOf(frame.pose)) += variance * (frame.gauge + hardly_known);
  }
  for (const Tie& tie : ties_) {
    if (tie.left_out || tie.counted) continue;
    const auto addOwn = [&](int pose, const Jacobian& J) {
      if (pose < 0) return;
      system->diagonal(system->positionOf(pose)) += variance * J.transpose() * J;
      system->right(system->positionOf(pose)) -= variance * tie.pull * J.transpose() * tie.residual;
    };
    addOwn(tie.marker, tie.J_marker);
    addOwn(tie.other, tie.J_other);
    if (tie.marker < 0 || tie.other < 0) continue;
    const int of_marker = system->positionOf(tie.marker);
    const int of_other = system->positionOf(tie.other);
    Matrix6d cross = variance * tie.J_marker.transpose() * tie.J_other;
    if (of_marker < of_other) cross.transposeInPlace();
    system->block(system->place(std::max(of_marker, of_other), std::min(of_marker, of_other))) +=
        cross;
  }
}

void ConstraintInformation::solved(BlockSystem* system) {
  for (Tie& tie : ties_) {
    if (tie.marker >= 0)
      tie.residual += tie.J_marker * system->right(system->positionOf(tie.marker));
    if (tie.other >= 0) tie.residual += tie.J_other * system->right(system->positionOf(tie.other));
  }
}

Eigen::Matrix3d ConstraintInformation::covarianceOf(const Tie& tie, double variance,
                                                    BlockSystem* system) {
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  const auto add = [&](int a, const Jacobian& J_a, int b, const Jacobian& J_b) {
    if (a >= 0 && b >= 0) covariance += variance * J_a * blockOf(a, b, system) * J_b.transpose();
  };
  add(tie.marker, tie.J_marker, tie.marker, tie.J_marker);
  // A frame that was found without it is as good as known.
  if (tie.left_out && tie.to_frame) return covariance;
  add(tie.other, tie.J_other, tie.other, tie.J_other);
  add(tie.marker, tie.J_marker, tie.other, tie.J_other);
  add(tie.other, tie.J_other, tie.marker, tie.J_marker);
  return covariance;
}

std::vector<ConstraintResidual> ConstraintInformation::residuals(double variance,
                                                                 BlockSystem* system) const {
  std::vector<double> squared(sources_.size(), -1.0);
  for (const Tie& tie : ties_) {
    const Eigen::Matrix3d of_map = covarianceOf(tie, variance, system);
    const Eigen::Matrix3d of_itself = Eigen::Matrix3d::Identity();
    // Its share in the map makes a residual smaller than it would be without.
    const Eigen::Matrix3d covariance =
        tie.left_out ? Eigen::Matrix3d(of_itself + of_map) : Eigen::Matrix3d(of_itself - of_map);
    double& sum = squared[at(tie.source)];
    sum = std::max(sum, 0.0) + squaredSigmas(tie.residual, covariance);
  }
  std::vector<ConstraintResidual> residuals;
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    if (squared[i] < 0.0) continue;
    // Positions that contradict each other are all left out, and nothing is left to hold one
    // against.
    const double alone = left_out_by_.empty() ? 0.0 : left_out_by_[i];
    residuals.push_back({sources_[i], std::max(std::sqrt(squared[i]), alone)});
  }
  return residuals;
}

}  // namespace waymark::slam
