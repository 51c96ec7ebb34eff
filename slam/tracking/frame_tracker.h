// A frame's way from its usable markers to its pose (seed 1, sections 4.2, 4.3 and 4.8): corners as
// at the middle row's time, those the map knows, those that may be tracked, the pose, and what fits
// it. Each stage takes what the one before has found and returns its own.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/camera/rolling_shutter_estimator.h"
#include "slam/frame_time.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/twist.h"
#include "slam/map/map.h"
#include "slam/no_pose_reason.h"
#include "slam/pose_estimate.h"
#include "slam/tracking/local_markers.h"
#include "slam/tracking/prediction.h"
#include "slam/tracking/tracker.h"

namespace waymark::slam {

// The usable markers of a frame, by what they are good for. Valid until the next frame.
struct FrameMarkers {
  FrameTime time;
  std::span<const MarkerDetection> detections;  // as at the middle row's time
  std::span<const KnownMarker> known;           // those of them with a pose in the map
  std::span<const KnownMarker> eligible;        // of the known ones, those that may be tracked
  std::span<const KnownMarker> loop;            // the other known ones: they close a loop
};

// A frame that has a pose. Valid until the next frame.
struct TrackedFrame {
  FrameTime time;
  PoseSolution solution;  // one flag for each of `eligible`
  Twist twist = Twist::Zero();
  TrackingMethod method = TrackingMethod::kPredicted;
  // What is not known of the motion while a rolling shutter read it adds to its covariances.
  Matrix6d of_readout = Matrix6d::Zero();
  // As one of a single marker's two poses; empty where several markers were in view.
  std::optional<PoseOfTwo> single;
  std::span<const KnownMarker> eligible;  // what it was found from
  std::span<const KnownMarker> loop;
  std::span<const MarkerDetection> fitting;  // once FrameTracker::fit() has told
};

// The pose is not one of two that nothing has decided between.
[[nodiscard]] inline bool isCertain(const TrackedFrame& frame) {
  return !frame.single || frame.single->decided;
}
// What its covariances have to be widened by: a single marker's other pose, and that motion.
[[nodiscard]] inline Matrix6d coverOf(const TrackedFrame& frame) {
  if (!frame.single) return frame.of_readout;
  return frame.of_readout + coverOfOtherPose(*frame.single, frame.solution.covariance);
}

// As a keyframe of what fits.
[[nodiscard]] inline Keyframe keyframeOf(const TrackedFrame& frame,
                                         std::span<const MarkerDetection> fitting) {
  return {-1,
          frame.time.sequence,
          frame.time.monotonic_ns,
          frame.solution.T_w_c,
          {fitting.begin(), fitting.end()},
          frame.twist};
}

struct TrackingOutcome {
  std::optional<TrackedFrame> frame;
  NoPoseReason reason = NoPoseReason::kNone;
  // Poses that were computed and rejected: a predicted one, or all there were.
  int rejected_poses = 0;
  // What was near is not near any more, perhaps: there is no pose, or one from markers elsewhere.
  bool lost_place = false;
};

// How a frame's markers agree with its pose. Valid until the next frame.
struct FittedMarkers {
  struct Verdict {
    int marker = -1;
    bool agrees = false;
  };
  // The detections that agree, and those the map has no pose for, sorted by id.
  std::span<const MarkerDetection> fitting;
  // On the markers that the others say something about.
  std::span<const Verdict> verdicts;
  int rejected = 0;  // left out of the pose
};

// All that it is given must outlive it.
class FrameTracker {
 public:
  FrameTracker(const CameraModel& camera, const TrackerOptions& options,
               const RollingShutterEstimator& rolling_shutter)
      : camera_(camera),
        rolling_shutter_(rolling_shutter),
        tracker_(camera.focalLength(), options),
        options_(options),
        judge_(camera.focalLength(), options.single_marker, options.relocalization.square),
        residual_variance_(options.residual_variance) {}

  // Where the camera is expected; empty without a recent pose.
  [[nodiscard]] std::optional<Prediction> predict(std::int64_t time_ns) const {
    return tracker_.predict(time_ns);
  }
  // What the map knows of the markers, and which of them may be tracked. Without an eligible one it
  // is not a closing loop but another place: then the others are.
  [[nodiscard]] FrameMarkers split(const Map& map, std::span<const MarkerDetection> usable,
                                   const FrameTime& time,
                                   const std::optional<Prediction>& prediction,
                                   const LocalMarkers& local);
  // The pose from the eligible markers (Eq. 36), or else from all that the map knows.
  [[nodiscard]] TrackingOutcome track(const Map& map, const FrameMarkers& markers,
                                      const std::optional<Prediction>& prediction);
  // residual_sigma: the map's.
  [[nodiscard]] FittedMarkers fit(const Map& map, const FrameMarkers& markers,
                                  const TrackedFrame& frame, double residual_sigma);
  // Its covariances are those relative to the markers in view.
  [[nodiscard]] PoseEstimate estimateOf(const TrackedFrame& frame) const;

  // The pose was accepted, and the map moved under the camera: as Tracker's.
  void commit(const PoseEstimate& pose, std::int64_t time_ns) {
    tracker_.commit(pose.T_w_c, pose.view_covariance, time_ns);
  }
  void correct(const Transform& T_new_old) {
    if (const auto last = tracker_.lastPose()) tracker_.correct(T_new_old * *last);
  }
  // The residuals so far were of another lens.
  void forgetNoise() {
    residual_variance_ = ResidualVariance(options_.residual_variance);
    judge_.forget();
  }
  [[nodiscard]] const Tracker& tracker() const { return tracker_; }

 private:
  [[nodiscard]] std::optional<TrackedPose> trackSingle(const KnownMarker& marker,
                                                       std::int64_t time_ns,
                                                       const std::optional<Prediction>& prediction,
                                                       std::optional<PoseOfTwo>* single);
  void deskewAgain(const Map& map, TrackedFrame* frame);
  [[nodiscard]] bool optimizeDeskewed(const Map& map, const Twist& twist, TrackedFrame* frame);

  const CameraModel& camera_;
  const RollingShutterEstimator& rolling_shutter_;
  Tracker tracker_;
  TrackerOptions options_;
  SingleMarkerJudge judge_;
  bool certain_ = false;  // of the last pose
  ResidualVariance residual_variance_;
  // What the values above refer to; reused from frame to frame.
  std::vector<MarkerDetection> detections_;
  std::vector<KnownMarker> known_;  // pointing into detections_
  SplitMarkers split_;              // likewise
  std::vector<MarkerDetection> fitting_;
  std::vector<FittedMarkers::Verdict> verdicts_;
};

}  // namespace waymark::slam
