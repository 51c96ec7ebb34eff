// What is done with a map once no frame waits for it any more: views of recorded frames beyond the
// keyframes, global optimization (seed 1, section 4.10), with the lens among the unknowns if wanted
// (Eq. 41), and where a recorded frame is in the map then.
#pragma once

#include <optional>
#include <span>

#include "slam/camera/lens_knowledge.h"
#include "slam/camera/lens_optimizer.h"
#include "slam/camera/rolling_shutter_estimator.h"
#include "slam/covariance/camera_uncertainty.h"
#include "slam/covariance/map_covariance.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/mapping/map_updater.h"
#include "slam/mapping/recorded_frames.h"
#include "slam/marker_screening/marker_screening.h"
#include "slam/options.h"
#include "slam/pose_estimate.h"
#include "slam/tracking/tracker.h"

namespace waymark::slam {

// What it works on, all of it another's, which must outlive it.
struct BatchMapperParts {
  const Options& options;
  const MarkerScreening& screening;
  const RollingShutterEstimator& rolling_shutter;
  const Tracker& tracker;
  CameraModel* camera;
  const LensKnowledge& lens;
  const CameraUncertainty& uncertainty;
  MapUpdater* updater;  // idle whenever the map is to change
  MapCovariance* covariance;
  Map* map;
};

class BatchMapper {
 public:
  // The map as it is given at the start: its keyframes are another run's.
  explicit BatchMapper(const BatchMapperParts& parts);

  // Of the map as it is.
  void recoverCovariance();
  // These change the map, and do nothing when mapping is off; see Slam.
  void densify(std::span<const RecordedFrame> frames);
  void optimize();
  void optimizeWithIntrinsics();

  [[nodiscard]] std::optional<PoseEstimate> localize(const RecordedFrame& frame) const;
  [[nodiscard]] std::optional<PosesOfOneMarker> localizeByOneMarker(
      const RecordedFrame& frame) const;

 private:
  [[nodiscard]] bool hasMapToOptimize() const;
  [[nodiscard]] ExpectedLens expectedLens() const;
  [[nodiscard]] std::optional<PoseEstimate> localizeByPicture(const RecordedFrame& frame) const;
  // The pose, its covariance as the map's residuals, the map's own doubt and the camera's have it.
  [[nodiscard]] PoseEstimate estimateOf(const std::vector<KnownMarker>& known,
                                        const RecordedFrame& frame, PoseSolution* solution) const;

  BatchMapperParts with_;
  KeyframeId last_old_keyframe_;  // of the map given at the start; -1 for none
  RecordedFrameLocator locator_;
};

}  // namespace waymark::slam
