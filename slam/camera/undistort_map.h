// A map after the camera has turned out to be another one.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "slam/camera/lens_knowledge.h"
#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"

namespace waymark::slam {

// The detections' normalized corners follow from their pixels anew, with this lens and this
// shutter. One that the lens cannot have seen leaves its keyframe.
// since_ns: keyframes before that time were seen through another lens, and stay as they are.
void undistortAgain(const CameraModel& camera, double readout_s, Map* map,
                    std::int64_t since_ns = std::numeric_limits<std::int64_t>::min());
// The same, each keyframe through the lens of its time.
void undistortAgain(const CameraModel& in_use, const LensKnowledge& lens, std::int64_t since_ns,
                    double readout_s, Map* map);
// The same of one keyframe.
void undistortAgain(const CameraModel& camera, double readout_s, KeyframeId keyframe, Map* map);
// The same of a frame's detections, as a global shutter saw them.
void undistortAgain(const CameraModel& camera, std::vector<MarkerDetection>* detections);

// Keyframes that were seen through another lens than the one in use get the pixels in which this
// one would have seen the same: a map in a file has one camera.
void seeThroughOne(const CameraModel& in_use, const LensKnowledge& lens, Map* map);

// What is not known of the readout time, sigma_s, becomes noise of the corners of this keyframe
// (doubtReadout, rolling_shutter.h).
void doubtReadout(const CameraModel& camera, double sigma_s, KeyframeId keyframe, Map* map);
// Whether that is in any corner of the map.
[[nodiscard]] bool isDoubted(const Map& map);
// It is known by now: the noise of all corners is the image's again.
void trustReadout(Map* map);

}  // namespace waymark::slam
