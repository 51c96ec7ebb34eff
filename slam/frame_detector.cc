#include "slam/frame_detector.h"

#include <utility>

namespace waymark::slam {

FrameDetector::FrameDetector(const CameraModel& camera, Dictionary dictionary,
                             const DetectorOptions& detector, const FollowerOptions& follower,
                             Counters* counters)
    : follower_(camera, std::move(dictionary), detector, follower), counters_(counters) {}

std::span<const MarkerDetection> FrameDetector::detect(const FrameInput& frame, const Map& map,
                                                       const LocalMarkers& local,
                                                       const std::optional<Prediction>& prediction,
                                                       StageObserver* observer) {
  if (frame.detections || !frame.image) {
    return frame.detections.value_or(std::span<const MarkerDetection>{});
  }
  const StageScope scope(observer, Stage::kDetect);
  const auto expected = expectation_.update(map, prediction, local, follower_.followed());
  const auto& found = follower_.find(*frame.image, frame.time.monotonic_ns, expected, observer);
  countSearch();
  return found;
}

void FrameDetector::countSearch() {
  switch (follower_.mode()) {
    case SearchMode::kFullScan:
      ++counters_->full_scans;
      break;
    case SearchMode::kFollowing:
      ++counters_->followed_frames;
      break;
    case SearchMode::kInTurns:
      ++counters_->busy_frames;
      break;
  }
  counters_->deferred_candidates = follower_.work().deferred;
  const DetectorCounters& detector = follower_.counters();
  counters_->quads = detector.quads;
  counters_->merged_quads = detector.merged;
  counters_->rejected_quads = detector.rejected;
  counters_->quads_without_edges = detector.no_edge;
  counters_->quads_without_code = detector.no_code;
  counters_->quads_unlike_code = detector.unlike;
}

}  // namespace waymark::slam
