// From frame to frame (seed 1, sections 4.3 and 4.8): the camera pose from the predicted one where
// there is one, else from the markers alone.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "slam/camera_pose/known_marker.h"
#include "slam/camera_pose/pose_optimizer.h"
#include "slam/camera_pose/residual_variance.h"
#include "slam/pose_estimate.h"
#include "slam/relocalization/relocalizer.h"
#include "slam/tracking/motion_model.h"
#include "slam/tracking/single_marker.h"

namespace waymark::slam {

struct TrackerOptions {
  PoseOptimizerOptions pose;
  MotionModelOptions motion;
  RelocalizerOptions relocalization;
  SingleMarkerOptions single_marker;
  ResidualVarianceOptions residual_variance;
  // Of two markers that contradict each other, one is believed whose own pose is nearer to the
  // predicted one than this share of what residuals a pose may have (pose.max_rms_px), as an angle
  // in the image. Smaller loses the pose in jerks, larger may believe the one that moved.
  double max_innovation_per_rms = 0.5;
  // Markers that must fit a pose before one that does not is held to disagree: with a single one
  // nobody knows which of the two is wrong. More notices a moved marker only where many are in
  // view.
  int min_witnesses = 2;
  // Added to both chi-squares before they make the ambiguity that is told of a pose: exact corners
  // are no certainty beyond measure.
  double ambiguity_floor = 1.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

enum class TrackingMethod { kPredicted, kRelocalized };

struct TrackedPose {
  PoseSolution solution;
  TrackingMethod method = TrackingMethod::kPredicted;
  // The predicted pose was tried and rejected.
  bool prediction_rejected = false;
};

class Tracker {
 public:
  Tracker(double focal_px, const TrackerOptions& options);

  // The pose of the frame; empty when the markers do not give one. `prediction`: empty where
  // nothing is expected. Changes nothing: commit() does.
  [[nodiscard]] std::optional<TrackedPose> track(std::span<const KnownMarker> markers,
                                                 const std::optional<Prediction>& prediction) const;
  // The pose was accepted: the next prediction starts from it.
  void commit(const Transform& T_w_c, const Matrix6d& covariance, std::int64_t time_ns) {
    motion_.update(T_w_c, covariance, time_ns);
  }
  // The map moved under the camera: same instant, new coordinates.
  void correct(const Transform& T_w_c) { motion_.correct(T_w_c); }

  [[nodiscard]] std::optional<Prediction> predict(std::int64_t time_ns) const {
    return motion_.predict(time_ns);
  }
  // Of the last frame that had one.
  [[nodiscard]] std::optional<Transform> lastPose() const { return motion_.lastPose(); }
  // As MotionModel's; zero where nothing is known. Before commit().
  [[nodiscard]] Vector6d twistTo(const Transform& T_w_c, std::int64_t time_ns) const {
    return motion_.twistTo(T_w_c, time_ns).value_or(Vector6d::Zero());
  }

  [[nodiscard]] Matrix6d twistCovariance(std::int64_t time_ns) const {
    return motion_.twistCovariance(time_ns);
  }

  // Of a frame out of turn: the pose nearest to a guess, else from the markers alone.
  [[nodiscard]] std::optional<PoseSolution> locate(std::span<const KnownMarker> markers,
                                                   const Transform& guess_T_w_c) const;
  // What is told of a solution. `markers`: those that it was found from.
  [[nodiscard]] PoseEstimate estimateOf(const PoseSolution& solution,
                                        std::span<const KnownMarker> markers,
                                        const Vector6d& twist) const;

  [[nodiscard]] const PoseOptimizer& optimizer() const { return optimizer_; }
  [[nodiscard]] double focalLength() const { return focal_px_; }

 private:
  [[nodiscard]] std::optional<PoseSolution> fromMarkersAlone(
      std::span<const KnownMarker> markers) const;
  [[nodiscard]] std::optional<PoseSolution> fromPrediction(std::span<const KnownMarker> markers,
                                                           const Transform& predicted) const;

  double focal_px_;
  TrackerOptions options_;
  PoseOptimizer optimizer_;
  MotionModel motion_;
};

// How much worse the other solution of the frame's largest marker explains the inliers: large is
// unambiguous, 1 is a coin toss. Precondition: one flag per marker, at least one of them set.
[[nodiscard]] double poseAmbiguity(const PoseSolution& solution,
                                   std::span<const KnownMarker> markers, double focal_px,
                                   const TrackerOptions& options);

}  // namespace waymark::slam
