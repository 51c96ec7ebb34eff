// Markers that are seen, where no test asks how.
#pragma once

#include "slam/map/map.h"

namespace waymark::slam::testing {

inline MarkerDetection seen(int id) {
  MarkerDetection detection;
  detection.id = id;
  return detection;
}

// A line of keyframes 10 cm apart that all see marker 1; one of them sees marker 2 as well.
inline Map lineOfKeyframes(int count, int sees_another = -1) {
  Map map;
  for (const int id : {1, 2}) {
    map.addMarker(id, 0.1);
    map.place(id, Transform{});
  }
  for (int i = 0; i < count; ++i) {
    Keyframe keyframe;
    keyframe.T_w_c.p = {0.1 * i, 0.0, 0.0};
    keyframe.detections = {seen(1)};
    if (i == sees_another) keyframe.detections.push_back(seen(2));
    (void)map.addKeyframe(keyframe);
  }
  return map;
}

}  // namespace waymark::slam::testing
