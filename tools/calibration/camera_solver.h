// Intrinsics and lens from views of a flat board, with the board's pose in each view: bundle
// adjustment by Levenberg-Marquardt, the poses eliminated (Schur complement), Huber's kernel.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"
#include "tools/calibration/board_detector.h"

namespace waymark::calibration {

// Which lens is looked for. Parameters, in this order:
enum class Lens {
  kPlumbBob,     // fx fy cx cy k1 k2 p1 p2 k3
  kRational,     // fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6
  kEquidistant,  // fx fy cx cy k1 k2 k3 k4
};

[[nodiscard]] std::vector<std::string> parameterNames(Lens lens);
[[nodiscard]] Eigen::VectorXd parametersOf(const slam::Calibration& camera, Lens lens);
[[nodiscard]] slam::Calibration withParameters(slam::Calibration camera, Lens lens,
                                               const Eigen::VectorXd& parameters);
// d pixel / d parameters, 2 x parameters, of a point at z = 1.
[[nodiscard]] Eigen::Matrix2Xd parameterJacobian(const slam::CameraModel& camera, Lens lens,
                                                 const Eigen::Vector2d& normalized);

struct SolverOptions {
  int max_iterations = 60;
  // Residuals beyond this many standard deviations count linearly only.
  double huber_sigmas = 2.5;
};

struct SolvedView {
  slam::Transform T_c_b;  // of the board in the camera's frame
  std::vector<Eigen::Vector2d>
      residuals;        // projected less seen, pixels, in the order of the points
  double rms_px = 0.0;  // of the distances
};

struct Solution {
  slam::Calibration camera;
  Lens lens = Lens::kPlumbBob;
  // Of the parameters, each the larger of two estimates: from the residuals taken as independent,
  // and from what each view as a whole pulls at them (a bent board pulls all of its corners at
  // once). Infinite where they are not determined.
  Eigen::MatrixXd covariance;
  // The same for all of them together: as of independent residuals, larger by what the views pull
  // more on average. (What a few views pull at leaves no doubt about what they happen to agree on.)
  Eigen::MatrixXd joint_covariance;
  std::vector<SolvedView> views;
  double noise = 1.0;   // standard deviation of the whitened residuals
  double rms_px = 0.0;  // of the distances, over all points

  [[nodiscard]] double sigma(Eigen::Index parameter) const;
  // The camera with the covariance of its intrinsics, which it does not have where they are not
  // determined.
  [[nodiscard]] slam::Calibration measuredCamera() const;
};

// From scratch. `board`: the points that the views' indices mean, metres, in z = 0 or nearly so.
// Empty when no camera explains the views: fewer than three of them, or points on a line.
[[nodiscard]] std::optional<Solution> solveCamera(const std::vector<Eigen::Vector3d>& board,
                                                  std::span<const std::vector<BoardPoint>> views,
                                                  int width, int height, Lens lens,
                                                  const SolverOptions& options = {});

}  // namespace waymark::calibration
