// Marker corners that somebody else's detector found and recorded, instead of images.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "base/result.h"
#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"

namespace waymark::io {

struct RecordedFrame {
  std::int64_t time_ns = 0;
  std::vector<slam::MarkerDetection> detections;  // sorted by id; may be empty
};

struct RecordedDetectionsOptions {
  // How well a recorded corner is known, pixels (one sigma, each direction). The files do not say;
  // 0.3 is what detectors without a line fit reach on real images.
  double corner_sigma_px = 0.3;
};

struct RecordedDetections {
  std::vector<RecordedFrame> frames;  // in the order of time
  std::uint64_t outside_lens = 0;     // detections dropped: a corner cannot be undistorted
};

// `path` has lines "t,id,hamming,x0,y0,...,x3,y3": seconds, and corners in pixels counted from
// pixel centres, in AprilTag's order (bottom-left, bottom-right, top-right, top-left of the upright
// tag);
// '#' begins a comment. A frames.csv beside it, one time a line, names all frames, also those
// without a marker; without it, frames are the times that occur. Errors name the file and the line.
[[nodiscard]] Result<RecordedDetections> readRecordedDetections(
    const std::filesystem::path& path, const slam::CameraModel& camera,
    const RecordedDetectionsOptions& options = {});

}  // namespace waymark::io
