// How good a map and a trajectory could be with the corners at hand: bundle adjustment of all
// camera and marker poses, started from the truth. Whatever a SLAM makes of the same corners is
// measured against it.
#pragma once

#include <cstddef>
#include <span>

#include "base/result.h"
#include "io/maps/map_file.h"
#include "io/recorded_detections.h"
#include "io/trajectory.h"
#include "slam/geometry/camera_model.h"
#include "slam/optimization/bundle_adjuster.h"
#include "tools/evaluation/evaluation.h"

namespace waymark::tools {

struct LimitOptions {
  // Frames that take part, evenly spread over those that see a marker of the truth. More gives a
  // lower limit and takes longer; 180 is some keyframes' worth for each of 50 to 100 markers.
  std::size_t frames = 180;
  // A view of a marker is gross, and left out, when a corner is farther from its true place than
  // both of these: pixels, and a multiple of the median distance over all views (a rolling shutter
  // moves every corner by pixels). A moved marker, a second print of an id and a false id are
  // gross.
  double gross_px = 3.0;
  double gross_per_median = 10.0;
  // To the very bottom: this runs once.
  slam::BundleOptions bundle{.max_iterations = 200, .min_relative_decrease = 1e-9};
};

struct AccuracyLimit {
  std::size_t frames = 0;
  std::size_t views = 0;          // of markers in frames that took part
  std::size_t outlier_views = 0;  // left out of the whole recording
  // Corners of all views that are not gross against the truth, RMS of a coordinate, pixels.
  double corner_rms_px = 0.0;
  TrajectoryErrors trajectory;
  MapErrors map;
};

// An error when the truth explains none of the detections, or the adjustment fails.
[[nodiscard]] Result<AccuracyLimit> accuracyLimit(std::span<const io::RecordedFrame> recorded,
                                                  const slam::CameraModel& camera,
                                                  const io::Trajectory& truth,
                                                  std::span<const io::MarkerCorners> truth_map,
                                                  const TrajectoryOptions& trajectory_options,
                                                  const LimitOptions& options);

}  // namespace waymark::tools
