// Ceres as the independent check of our optima: the same bundle problem, its residuals written anew
// and differentiated numerically.
#pragma once

#include <array>
#include <cmath>
#include <deque>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <ceres/ceres.h>

#include "slam/map/marker_constraints.h"
#include "slam/optimization/bundle_problem.h"

namespace waymark::slam::testing {

// Translation, rotation vector.
using PoseBlock = std::array<double, 6>;

inline PoseBlock blockOf(const Transform& T) {
  const Eigen::Vector3d r = logSo3(T.R);
  return {T.p.x(), T.p.y(), T.p.z(), r.x(), r.y(), r.z()};
}

inline Transform poseOf(const double* block) {
  return {expSo3({block[3], block[4], block[5]}), {block[0], block[1], block[2]}};
}

// Ours is the sum of squares; Ceres halves it.
inline double solveWithCeres(ceres::Problem* problem) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-14;
  options.gradient_tolerance = 1e-14;
  options.parameter_tolerance = 1e-14;
  ceres::Solver::Summary summary;
  ceres::Solve(options, problem, &summary);
  return 2.0 * summary.final_cost;
}

inline double costWithCeres(ceres::Problem* problem) {
  double cost = 0.0;
  problem->Evaluate({}, &cost, nullptr, nullptr, nullptr);
  return 2.0 * cost;
}

// Infinite huber: plain least squares. A lens's corners are whitened where it stands at the start,
// as our adjuster does.
class CeresBundle {
 public:
  CeresBundle(const BundleProblem& problem, double huber) {
    for (const auto& pose : problem.cameras) addPose(pose, &cameras_);
    for (const auto& pose : problem.markers) addPose(pose, &markers_);
    if (problem.lens) addLens(*problem.lens);
    for (const auto& o : problem.observations) {
      for (std::size_t k = 0; k < 4; ++k) addCorner(problem, o, k, huber);
    }
    for (const auto& prior : problem.priors) {
      problem_.AddResidualBlock(
          new ceres::NumericDiffCostFunction<PriorResidual, ceres::CENTRAL, 6, 6>(
              new PriorResidual{prior.T_w_m, prior.information.llt().matrixU()}),
          nullptr, markers_[at(prior.marker)].data());
    }
  }

  CeresBundle(const CeresBundle&) = delete;  // Ceres points into it
  CeresBundle& operator=(const CeresBundle&) = delete;

  // Between two corners of two markers of that size.
  void addDistance(const CornerDistance& distance, double size_m) {
    problem_.AddResidualBlock(
        new ceres::NumericDiffCostFunction<DistanceResidual, ceres::CENTRAL, 1, 6, 6>(
            new DistanceResidual{distance, size_m}),
        nullptr, markers_[at(distance.id_a)].data(), markers_[at(distance.id_b)].data());
  }
  // All of them face out of one plane.
  void addPlane(const std::vector<int>& markers, double sigma_m, double sigma_rad) {
    const Transform T_w_m = marker(markers.front());
    const Eigen::Vector3d n = T_w_m.R.col(2);
    planes_.push_back({n.x(), n.y(), n.z(), n.dot(T_w_m.p)});
    for (const int m : markers) {
      problem_.AddResidualBlock(
          new ceres::NumericDiffCostFunction<PlaneResidual, ceres::CENTRAL, 4, 4, 6>(
              new PlaneResidual{sigma_m, sigma_rad}),
          nullptr, planes_.back().data(), markers_[at(m)].data());
    }
  }

  double cost() { return costWithCeres(&problem_); }
  double solve() { return solveWithCeres(&problem_); }
  [[nodiscard]] Transform camera(int i) const { return poseOf(cameras_[at(i)].data()); }
  [[nodiscard]] Transform marker(int i) const { return poseOf(markers_[at(i)].data()); }

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }

  static Eigen::Vector3d inCamera(const double* camera, const double* marker, double size_m,
                                  std::size_t k) {
    return poseOf(camera).inverse() * (poseOf(marker) * markerCorners(size_m)[k]);
  }

  struct CornerResidual {
    const MarkerDetection* detection;
    std::size_t k;
    double size_m;
    Eigen::Matrix2d whitening;
    bool operator()(const double* camera, const double* marker, double* residual) const {
      const Eigen::Vector3d x = inCamera(camera, marker, size_m, k);
      Eigen::Map<Eigen::Vector2d>(residual, 2) =
          whitening * (Eigen::Vector2d(x.head<2>() / x.z()) - detection->normalized[k]);
      return true;
    }
  };

  struct PixelResidual {
    CameraModel lens;
    const MarkerDetection* detection;
    std::size_t k;
    double size_m;
    Eigen::Matrix2d whitening;
    bool operator()(const double* camera, const double* marker, const double* intrinsics,
                    double* residual) const {
      const Eigen::Vector3d x = inCamera(camera, marker, size_m, k);
      const CameraModel model(
          lens.withIntrinsics(Eigen::Map<const IntrinsicVector>(intrinsics, 9)));
      Eigen::Map<Eigen::Vector2d>(residual, 2) =
          whitening * (model.distort(x.head<2>() / x.z()) - detection->pixels[k]);
      return true;
    }
  };

  struct PriorResidual {
    Transform T_w_m;
    Matrix6d root;  // root^T root is the information
    bool operator()(const double* marker, double* residual) const {
      Eigen::Map<Vector6d>(residual, 6) = root * T_w_m.localCoordinates(poseOf(marker));
      return true;
    }
  };

  struct DistanceResidual {
    CornerDistance known;
    double size_m;
    bool operator()(const double* a, const double* b, double* residual) const {
      const auto corners = markerCorners(size_m);
      const Eigen::Vector3d along =
          poseOf(a) * corners[at(known.corner_a)] - poseOf(b) * corners[at(known.corner_b)];
      *residual = (along.norm() - known.distance_m) / known.sigma_m;
      return true;
    }
  };

  // Of a normal of any length, and the distance of the plane from the origin.
  struct PlaneResidual {
    double sigma_m, sigma_rad;
    bool operator()(const double* plane, const double* marker, double* residual) const {
      const Eigen::Vector3d n = Eigen::Vector3d(plane[0], plane[1], plane[2]).normalized();
      const Transform T_w_m = poseOf(marker);
      residual[0] = (n.dot(T_w_m.p) - plane[3]) / sigma_m;
      Eigen::Map<Eigen::Vector3d>(residual + 1) = (T_w_m.R.col(2) - n) / sigma_rad;
      return true;
    }
  };

  struct LensResidual {
    IntrinsicVector expected;
    IntrinsicMatrix root;  // root^T root is the information
    bool operator()(const double* intrinsics, double* residual) const {
      const Eigen::Map<const IntrinsicVector> v(intrinsics);
      Eigen::Map<IntrinsicVector>(residual, 9) = root * (v - expected);
      return true;
    }
  };

  void addPose(const BundleProblem::Pose& pose, std::deque<PoseBlock>* blocks) {
    blocks->push_back(blockOf(pose.T));
    problem_.AddParameterBlock(blocks->back().data(), 6);
    if (pose.fixed) problem_.SetParameterBlockConstant(blocks->back().data());
  }

  void addLens(const BundleProblem::Lens& lens) {
    intrinsics_ = lens.camera.intrinsics();
    std::vector<int> fixed;
    for (int i = 0; i < 9; ++i) {
      if (!(lens.covariance(i, i) > 0.0)) fixed.push_back(i);
    }
    problem_.AddParameterBlock(intrinsics_.data(), 9);
    if (!fixed.empty()) {
      problem_.SetManifold(intrinsics_.data(), new ceres::SubsetManifold(9, fixed));
    }
    problem_.AddResidualBlock(
        new ceres::NumericDiffCostFunction<LensResidual, ceres::CENTRAL, 9, 9>(
            new LensResidual{lens.expected, informationOf(lens.covariance).llt().matrixU()}),
        nullptr, intrinsics_.data());
  }

  void addCorner(const BundleProblem& problem, const BundleProblem::Observation& o, std::size_t k,
                 double huber) {
    ceres::LossFunction* loss = std::isfinite(huber) ? new ceres::HuberLoss(huber) : nullptr;
    double* camera = cameras_[at(o.camera)].data();
    double* marker = markers_[at(o.marker)].data();
    const double size_m = problem.marker_sizes_m[at(o.marker)];
    Eigen::Matrix2d covariance = o.detection->covariance[k];
    if (!problem.lens) {
      const Eigen::Matrix2d W = covariance.inverse().llt().matrixU();
      problem_.AddResidualBlock(
          new ceres::NumericDiffCostFunction<CornerResidual, ceres::CENTRAL, 2, 6, 6>(
              new CornerResidual{o.detection, k, size_m, W}),
          loss, camera, marker);
      return;
    }
    Eigen::Matrix2d J;
    (void)problem.lens->camera.distort(o.detection->normalized[k], &J);
    covariance = J * covariance * J.transpose();
    const Eigen::Matrix2d W = covariance.inverse().llt().matrixU();
    problem_.AddResidualBlock(
        new ceres::NumericDiffCostFunction<PixelResidual, ceres::CENTRAL, 2, 6, 6, 9>(
            new PixelResidual{problem.lens->camera, o.detection, k, size_m, W}),
        loss, camera, marker, intrinsics_.data());
  }

  std::deque<PoseBlock> cameras_, markers_;
  std::deque<std::array<double, 4>> planes_;
  IntrinsicVector intrinsics_ = IntrinsicVector::Zero();
  ceres::Problem problem_;
};

}  // namespace waymark::slam::testing
