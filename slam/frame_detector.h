// The first stage of a frame: the corners in its image, looked for where the map's markers are
// expected first; or those that come with it.
#pragma once

#include <optional>
#include <span>

#include "slam/counters.h"
#include "slam/detection/search/marker_follower.h"
#include "slam/frame.h"
#include "slam/map/map.h"
#include "slam/stages.h"
#include "slam/tracking/expected_markers.h"
#include "slam/tracking/local_markers.h"
#include "slam/tracking/prediction.h"

namespace waymark::slam {

class FrameDetector {
 public:
  // The camera and the counters must outlive it.
  FrameDetector(const CameraModel& camera, Dictionary dictionary, const DetectorOptions& detector,
                const FollowerOptions& follower, Counters* counters);

  [[nodiscard]] const Dictionary& dictionary() const { return follower_.dictionary(); }

  // Valid until the next call, or as long as the frame's own. `observer` may be null.
  [[nodiscard]] std::span<const MarkerDetection> detect(const FrameInput& frame, const Map& map,
                                                        const LocalMarkers& local,
                                                        const std::optional<Prediction>& prediction,
                                                        StageObserver* observer);

 private:
  void countSearch();

  MarkerFollower follower_;
  MarkerExpectation expectation_;
  Counters* counters_;
};

}  // namespace waymark::slam
