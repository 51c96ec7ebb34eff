// Tracking (seed 1, section 4.3): the camera pose from all valid markers of a frame, markers fixed.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

struct PoseOptimiserOptions {
  int max_iterations = 20;
  // Huber's threshold on a corner's whitened residual norm, without unit; 2.45 keeps 95 % of
  // Gaussian corners quadratic.
  double huber = 2.45;
  // A marker whose chi-square (8 residuals) exceeds this, after scaling by the frame's own median,
  // is left out: 26.1 is the 99.9 % quantile. Smaller rejects more good markers, larger lets a
  // moved one pull.
  double marker_chi2 = 26.1;
  // Two markers disagreeing cannot be told apart by a median; both are kept up to this RMS, pixels.
  double worst_rms_px = 3.0;
};

// One detected marker that the map knows.
struct PoseObservation {
  const MarkerDetection* detection = nullptr;
  std::array<Eigen::Vector3d, 4> corners_w;  // metres, world
};

struct PoseSolution {
  Transform T_w_c;
  // Of (dp, dtheta) in the world frame, scaled up where the residuals exceed the corner
  // covariances.
  Matrix6d covariance = Matrix6d::Zero();
  double chi2 = 0.0;         // whitened squared residuals of the inliers
  int inliers = 0;           // markers
  double rms_px = 0.0;       // per corner coordinate pair, inliers
  std::vector<bool> inlier;  // one per observation
};

class PoseOptimiser {
 public:
  // focal_px turns normalised residuals into pixels for rms_px.
  explicit PoseOptimiser(double focal_px, const PoseOptimiserOptions& options = {});

  // Levenberg-Marquardt on Eq. 22 from `guess`, robust, then gates and runs again without the
  // markers that do not fit. Empty when nothing can be projected or the normal equations are
  // singular.
  [[nodiscard]] std::optional<PoseSolution> optimise(std::span<const PoseObservation> observations,
                                                     const Transform& guess) const;

  // Sum of the whitened squared residuals of one marker (8 of them); empty behind the camera.
  [[nodiscard]] static std::optional<double> markerChi2(const PoseObservation& observation,
                                                        const Transform& T_w_c);

 private:
  struct Normal;
  [[nodiscard]] std::optional<Transform> minimise(std::span<const PoseObservation> observations,
                                                  const std::vector<bool>& use,
                                                  Transform T_w_c) const;

  double focal_px_;
  PoseOptimiserOptions options_;
};

}  // namespace waymark::slam
