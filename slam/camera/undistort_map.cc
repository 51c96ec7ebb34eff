#include "slam/camera/undistort_map.h"

#include <vector>

#include "slam/camera/rolling_shutter.h"

namespace waymark::slam {

void undistortAgain(const CameraModel& camera, double readout_s, Map* map) {
  map->beginEpoch();
  for (const auto& [id, keyframe] : map->keyframes()) {
    std::vector<int> unseen;
    const SharedDetections before = keyframe.detections;
    for (const MarkerDetection& detection : before) {
      const MapMarker& marker = map->markers().at(detection.id);
      const auto again = deskewed(detection, camera, keyframe.T_w_c, keyframe.twist, marker.T_w_m,
                                  marker.size_m, readout_s);
      if (again) map->replaceView(id, *again);
      if (!again) unseen.push_back(detection.id);
    }
    const KeyframeId only[] = {id};
    for (const int marker_id : unseen) map->removeViews(marker_id, only);
  }
}

}  // namespace waymark::slam
