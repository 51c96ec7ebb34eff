// Tracking (seed 1, section 4.3): the camera pose from all valid markers of a frame, markers fixed.
#pragma once

#include <algorithm>
#include <optional>
#include <span>
#include <string>

#include "slam/camera_pose/known_marker.h"
#include "slam/camera_pose/marker_flags.h"
#include "slam/geometry/reprojection.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

struct PoseOptimizerOptions {
  // At most, before the gate of marker_chi2 and again after it. More let worse guesses reach the
  // minimum and cost time.
  int max_iterations = 20;
  // Huber's threshold on a corner's whitened residual norm, in units of the frame's own noise; 2.45
  // keeps 95 % of Gaussian corners quadratic.
  double huber = 2.45;
  // A marker whose chi-square (8 residuals, in units of the frame's own noise) exceeds this is left
  // out: 26.1 is the 99.9 % quantile. Smaller rejects more good markers, larger lets a moved one
  // pull.
  double marker_chi2 = 26.1;
  // Only among at least so many markers: of two that disagree nobody knows which one is wrong. More
  // is surer of who is, and lets a moved marker pull where few are in view.
  int min_gated_markers = 3;
  // A marker that fits this well is never left out, pixels: below it the lens model and the paper
  // speak, not the marker.
  double inlier_rms_px = 0.35;
  // A pose is rejected when its residuals' RMS exceeds both of these: pixels, and a share of the
  // markers' mean side in the image (close by, a bent sheet is many pixels off).
  double max_rms_px = 3.0;
  double max_rms_per_side = 0.06;
  // At least this share of a frame's markers has to fit. With fewer nobody can say who is wrong:
  // the gate leaves out none, and a pose that fits fewer is rejected. Larger rejects more poses,
  // smaller believes a minority.
  double min_inlier_share = 0.5;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct PoseSolution {
  Transform T_w_c;
  // Of (dp, dtheta) in the world frame, for residuals of this variance.
  Matrix6d covariance = Matrix6d::Zero();
  // Of a whitened residual: 1, or more where the residuals exceed the corners' covariances by more
  // than chance explains.
  double residual_variance = 1.0;
  double chi2 = 0.0;          // whitened squared residuals of the inliers
  int inliers = 0;            // markers
  double rms_px = 0.0;        // of the corners' distances, inliers
  double mean_side_px = 0.0;  // of the inliers in the image
  MarkerFlags inlier;         // one per marker given

  [[nodiscard]] double degreesOfFreedom() const { return 8.0 * inliers - 6.0; }
  // Other poses' residuals are known to have this variance.
  void widenTo(double known_residual_variance) {
    if (known_residual_variance <= residual_variance) return;
    covariance *= known_residual_variance / residual_variance;
    residual_variance = known_residual_variance;
  }
};

// Weights of a marker's corners: their covariance in the image, and what the map's doubt about the
// marker adds to it, seen from T_w_c. The four corners share that doubt; as they are weighted one
// by one, each carries four times its own part, lest a doubtful marker count as four witnesses.
// Empty when a corner is behind the camera.
[[nodiscard]] std::optional<WhitenedCorners> whiteningOf(const KnownMarker& marker,
                                                         const Transform& T_w_c);

class PoseOptimizer {
 public:
  // focal_px turns normalized residuals into pixels for rms_px.
  explicit PoseOptimizer(double focal_px, const PoseOptimizerOptions& options = {});

  // Levenberg-Marquardt on Eq. 22 from `guess`, robust, every corner weighted by how well the image
  // and the map know it; then estimates the frame's noise from the residuals, gates the markers by
  // it and runs again with those that fit. Empty when nothing can be projected or the normal
  // equations are singular.
  [[nodiscard]] std::optional<PoseSolution> optimize(std::span<const KnownMarker> markers,
                                                     const Transform& guess) const;

  // Whether the residuals are small enough for the pose to mean anything.
  [[nodiscard]] bool acceptable(const PoseSolution& solution) const;

  // Sum of the whitened squared residuals of one marker (8 of them); empty behind the camera.
  [[nodiscard]] static std::optional<double> markerChi2(const KnownMarker& marker,
                                                        const Transform& T_w_c);
  // Whether a pose explains it; noise: of the residuals, in units of the corners' own.
  [[nodiscard]] bool explains(const KnownMarker& marker, const Transform& T_w_c,
                              double residual_sigma) const;
  // Whether the marker is at least where such a pose may leave it: as acceptable().
  [[nodiscard]] bool isNear(const KnownMarker& marker, const Transform& T_w_c) const {
    return rmsPx(marker, T_w_c) <= maxRmsPx(sidePx(*marker.detection));
  }

 private:
  [[nodiscard]] bool areEnough(std::size_t inliers, std::size_t markers) const;
  [[nodiscard]] double maxRmsPx(double side_px) const {
    return std::max(options_.max_rms_px, options_.max_rms_per_side * side_px);
  }
  [[nodiscard]] static double sidePx(const MarkerDetection& detection);
  // Infinite behind the camera.
  [[nodiscard]] double rmsPx(const KnownMarker& marker, const Transform& T_w_c) const;

  double focal_px_;
  PoseOptimizerOptions options_;
};

}  // namespace waymark::slam
