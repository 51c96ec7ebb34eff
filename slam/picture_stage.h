// The stage of natural markers (seed 2, sections 3.1 to 3.3): what somebody else has found in
// earlier frames, pictures and where the camera was of each, corrects the pose at that frame's own
// time, begins a map where there is none, and gives pictures their place in it. Of photographs in
// no order, where nothing is carried: what was found in the frame itself, at once.
#pragma once

#include <cstddef>
#include <deque>
#include <optional>
#include <span>

#include "slam/camera/rolling_shutter_estimator.h"
#include "slam/counters.h"
#include "slam/covariance/camera_uncertainty.h"
#include "slam/covariance/map_covariance.h"
#include "slam/feature_stage.h"
#include "slam/frame.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/mapping/map_updater.h"
#include "slam/options.h"
#include "slam/stages.h"

namespace waymark::slam {

// What it works on, all of it another's, which must outlive it.
struct PictureStageParts {
  const Options& options;
  const CameraUncertainty& camera;
  const RollingShutterEstimator& shutter;
  MapUpdater* updater;
  MapCovariance* covariance;
  FeatureStage* features;
  Map* map;
  Counters* counters;
};

// Pictures whose place is surveyed fix the world: as anchors, among the options' own.
[[nodiscard]] Options withSurveyedPictures(Options options);

class PictureStage {
 public:
  // Surveyed pictures are in a map that is there already, or that does not grow, from the start.
  explicit PictureStage(const PictureStageParts& parts);

  // Before a frame's own stages. True when the map changed.
  bool hear(std::span<const LateResult> late, StageObserver* observer);
  // Where there is no map: a photograph's pictures may begin one. Whether one has.
  [[nodiscard]] bool begin(const FrameInput& frame, StageObserver* observer);
  // Where its markers give none: a frame's pose from features, or a photograph's from a picture.
  [[nodiscard]] std::optional<PoseEstimate> bridge(const FrameInput& frame,
                                                   std::span<const MarkerDetection> detections,
                                                   StageObserver* observer);
  // What that pose is relative to: a marker or picture.
  [[nodiscard]] int anchor() const { return anchor_ ? *anchor_ : with_.features->anchor(); }
  // After them, of an awaited frame, or of a photograph, whose pictures take their place at once;
  // fitting: the detections that its pose is from. True when the map changed.
  bool await(const FrameInput& frame, const FrameResult& result,
             std::span<const MarkerDetection> fitting, StageObserver* observer);
  // All coordinates have changed.
  void moveWorld(const Transform& T_new_old);

  [[nodiscard]] bool any() const { return !with_.options.natural.prints.empty(); }

 private:
  struct Awaited {
    AwaitedFrame frame;
    CameraModel found_with;  // the lens in use then
  };

  [[nodiscard]] bool hearOne(const LateResult& heard, StageObserver* observer);
  [[nodiscard]] std::optional<LateResult> asKnownByNow(const Awaited& awaited,
                                                       const LateResult& heard,
                                                       const PicturePrint& print) const;
  [[nodiscard]] const PicturePrint* printOf(int id) const;
  [[nodiscard]] bool mayBegin(const PicturePrint& print) const;
  void beginMap(const AwaitedFrame& frame, const LateResult& seen, const PicturePrint& print);
  [[nodiscard]] bool grow(const AwaitedFrame& frame, const LateResult& seen,
                          const PicturePrint& print, StageObserver* observer);
  void placeSurveyed();
  void place(const PicturePrint& print, const Transform& T_w_m, const Matrix6d& covariance);

  PictureStageParts with_;
  std::deque<Awaited> awaited_;  // oldest first
  std::optional<int> anchor_;    // of a photograph's pose: the picture
};

}  // namespace waymark::slam
