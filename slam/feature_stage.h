// The stage of natural features (seed 2, section 3.3): they follow the markers while these give the
// pose, and give it themselves in between. Nothing of it happens in a frame without an image, or
// when it is off.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "slam/counters.h"
#include "slam/covariance/map_covariance.h"
#include "slam/frame.h"
#include "slam/geometry/camera_model.h"
#include "slam/late_result.h"
#include "slam/map/map.h"
#include "slam/natural/pose_integrator.h"
#include "slam/options.h"
#include "slam/stages.h"
#include "slam/tracking/frame_tracker.h"

namespace waymark::slam {

class FeatureStage {
 public:
  // All that it is given must outlive it.
  FeatureStage(const Options& options, const CameraModel& camera, MapCovariance& covariance,
               Counters* counters)
      : options_(options.natural),
        markers_(options.markers),
        resolver_(options.mapper.marker_pose),
        camera_(camera),
        covariance_(covariance),
        integrator_(options.natural, camera, counters),
        counters_(counters) {}

  // Before a frame: the rolling shutter that it is seen through, as VisualFilter's.
  void setReadout(double readout_s) { integrator_.setReadout(readout_s); }
  // After the markers have given a pose. False where the features know better.
  [[nodiscard]] bool follow(const FrameInput& frame, const TrackedFrame& tracked,
                            const PoseEstimate& pose, const Map& map, StageObserver* observer);
  // After follow(): the pose from features and markers together, with what the map does not know of
  // the place in its covariance. Empty where the markers alone know as well.
  [[nodiscard]] std::optional<PoseEstimate> fused() const;
  // Where they have given none: the pose, with what the map does not know of the place in its
  // covariance. detections: as at the middle row's time.
  [[nodiscard]] std::optional<PoseEstimate> bridge(const FrameInput& frame,
                                                   std::span<const MarkerDetection> detections,
                                                   const Map& map, StageObserver* observer);
  // After a bridge() without a pose: its state and reason, where that is because a carried pose
  // became less certain than its limit, then or since the last frame that had one.
  void tellIfLost(FrameResult* result) const;
  // After follow(): where a bridge has ended at markers that are known, as seen from where it
  // began.
  struct Arrival {
    FilteredPose pose;
    int anchor = -1;
  };
  [[nodiscard]] std::optional<Arrival> arrival() const;
  // After follow(): where features that have carried the pose through a gap before, and been
  // followed since, have the camera together with the markers in view.
  [[nodiscard]] std::optional<FilteredPose> carriedOn() const {
    return followed_ ? integrator_.carriedOn() : std::nullopt;
  }
  // The marker that the carried pose is relative to: the nearest one of the last frame that the
  // features followed. -1 before the first one.
  [[nodiscard]] int anchor() const { return anchor_.id; }
  // After all of these: somebody else looks at the frame, too.
  void await(const FrameInput& frame, bool has_pose, StageObserver* observer);
  // Before all of these: a picture of the map was seen in an awaited frame.
  void late(const LateResult& seen, const MapMarker& picture, const PicturePrint& print,
            StageObserver* observer);
  // The map has moved under the camera.
  void moveWorld(const Transform& T_new_old);
  // Where the features are was seen through another lens.
  void forget() { integrator_.giveUp(); }

 private:
  [[nodiscard]] bool concerns(const FrameInput& frame) const;
  // Where they are in the image, the filter may begin at them.
  [[nodiscard]] bool beginsAtAny(std::span<const KnownMarker> markers) const;
  [[nodiscard]] bool beginsAt(const LateResult& seen, const PicturePrint& print) const;
  // Where the map has put its only marker by now, the features go with it.
  void followAnchor(const Map& map);
  // Those that the map has no place for, and does not distrust; no more than the filter has room
  // for.
  void findUnplaced(std::span<const MarkerDetection> detections, const Map& map);
  [[nodiscard]] std::optional<PoseEstimate> inWorld(std::optional<PoseEstimate> pose) const;

  const NaturalOptions& options_;
  const MarkerOptions& markers_;
  const MarkerResolverOptions& resolver_;
  const CameraModel& camera_;
  MapCovariance& covariance_;
  PoseIntegrator integrator_;
  Counters* counters_;
  struct Anchor {
    int id = -1;
    Transform T_w_m;  // as the features know it
  };
  Anchor anchor_;
  int anchor_before_ = -1;  // the last frame
  bool followed_ = false;   // the last frame with a pose from markers
  bool refused_ = false;    // the last frame's carried pose was too uncertain
  bool lost_ = false;       // since one was, there has been no pose
  // Reused from frame to frame.
  std::vector<KnownMarker> fitting_;
  std::vector<UnplacedMarker> unplaced_;
  std::vector<Eigen::Vector3d> points_w_;
};

}  // namespace waymark::slam
