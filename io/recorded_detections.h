// Marker corners on file instead of images: what somebody else's detector found, or ours.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
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
  // How well a recorded corner is known where the file does not say, pixels (one sigma, each
  // direction); 0.3 is what detectors without a line fit reach on real images.
  double corner_sigma_px = 0.3;
};

struct RecordedDetections {
  std::vector<RecordedFrame> frames;  // in the order of time
  std::uint64_t outside_lens = 0;     // detections dropped: a corner cannot be undistorted
};

// `path` has lines "t,id,hamming,x0,y0,...,x3,y3": seconds, and corners in pixels counted from
// pixel centres, in AprilTag's order (bottom-left, bottom-right, top-right, top-left of the upright
// tag); '#' begins a comment. A line may go on with the corners' covariances in square pixels,
// "xx0,xy0,yy0,...,xx3,xy3,yy3", in the same order. A frames.csv beside it, one time a line, names
// all frames, also those without a marker; without it, frames are the times that occur. Errors name
// the file and the line.
[[nodiscard]] Result<RecordedDetections> readRecordedDetections(
    const std::filesystem::path& path, const slam::CameraModel& camera,
    const RecordedDetectionsOptions& options = {});

// The same from text; `path` is for errors. frame_times: the text of the frames.csv, if any.
[[nodiscard]] Result<RecordedDetections> parseRecordedDetections(
    const std::string& text, const std::optional<std::string>& frame_times,
    const std::filesystem::path& path, const slam::CameraModel& camera,
    const RecordedDetectionsOptions& options = {});

// How far the corners of such a file reach, pixels: all but one in 200, as detectors put a corner
// where the sides meet, and that may be some way outside the image.
struct ImageExtent {
  double right_px = 0.0;
  double bottom_px = 0.0;
};
[[nodiscard]] Result<ImageExtent> readImageExtent(const std::filesystem::path& path);

// The text of such a file, with covariances; every number reads back as it was. The camera is the
// one the frames were taken with.
[[nodiscard]] std::string formatRecordedDetections(std::span<const RecordedFrame> frames,
                                                   const slam::CameraModel& camera);
// The text of the frames.csv to it.
[[nodiscard]] std::string formatFrameTimes(std::span<const RecordedFrame> frames);

}  // namespace waymark::io
