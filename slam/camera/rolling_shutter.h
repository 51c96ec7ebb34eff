// Rolling shutters: the rows of an image are read one after the other, so a moving camera sees each
// marker at a time of its own. Corners are moved to where the middle row's time would have shown
// them. The readout time itself is learned: it is one more unknown of an optimization of the
// newest keyframes (readout_estimate.h). Beyond seed 1, which takes every camera for a global
// shutter.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/image_velocity.h"
#include "slam/geometry/transform.h"
#include "slam/geometry/twist.h"

namespace waymark::slam {

// The detection with `normalized`, given as seen, as at the middle row's time. depth_m: of each
// corner.
[[nodiscard]] MarkerDetection atMidFrame(const MarkerDetection& seen, const CameraModel& camera,
                                         const Twist& twist, const std::array<double, 4>& depth_m,
                                         double readout_s);
// A marker's distance as its size in the image tells it, for all four corners: good enough where
// the map does not know it.
[[nodiscard]] std::array<double, 4> depthFromSize(const MarkerDetection& seen, double size_m);
// The corners' depths of a marker at T_w_m; empty when one is not in front of the camera.
[[nodiscard]] std::optional<std::array<double, 4>> depthFromPose(const Transform& T_w_c,
                                                                 const Transform& T_w_m,
                                                                 double size_m);

// The detection as a global shutter would have shown it: `normalized` follows from the pixels,
// which stay as they were seen. T_w_m: the marker's pose, where the map knows it. Empty when a
// corner is outside the lens's range.
[[nodiscard]] std::optional<MarkerDetection> deskewed(const MarkerDetection& seen,
                                                      const CameraModel& camera,
                                                      const Transform& T_w_c, const Twist& twist,
                                                      const std::optional<Transform>& T_w_m,
                                                      double size_m, double readout_s);

// What is not known of the readout time, sigma_s, becomes noise of the corners
// (MarkerDetection::readout_doubt) in place of what was: the corners of one frame are off together,
// but until it is known, its views would speak too loud, and gates would take it for moved markers.
// Three of the corner's standard deviations at most.
void doubtReadout(const CameraModel& camera, const Transform& T_w_c, const Twist& twist,
                  const std::optional<Transform>& T_w_m, double size_m, double sigma_s,
                  MarkerDetection* detection);

struct RollingShutterOptions {
  // First to last row, seconds: 0 for a global shutter, negative where images are turned upside
  // down. Empty: learned ...
  std::optional<double> readout_s;
  // ... from this on, which an earlier run has learned.
  double learned_s = 0.0;
  // A learned readout is believed from this length on, seconds, and only if it is this many of its
  // standard deviations long: lens and map errors look like a little of it.
  double min_s = 0.003;
  double min_sigmas = 8.0;
  double max_s = 0.1;
  // Standard deviation of a readout time that nobody has told or estimated yet, seconds: most
  // cameras read for 10 to 30 ms, or at once. Larger makes the first poses of a moving camera less
  // certain, smaller is overconfident of those with a slow shutter.
  double unknown_s = 0.015;
  // A better one takes its place only if it differs by this many of its standard deviations: a
  // change moves every corner of the map.
  double min_change_sigmas = 2.0;
  // It is estimated when the map has this many keyframes, and again whenever it has grown by the
  // factor, from the newest ones of them, at most so many. Each time costs an optimization of
  // those; of the whole map, when a new readout time is believed.
  int first_keyframes = 8;
  double growth = 1.4;
  int max_keyframes = 100;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// Whether an estimate is to be used instead of the readout time in use.
[[nodiscard]] bool believable(double estimated_s, double sigma_s, double in_use_s,
                              const RollingShutterOptions& options);

}  // namespace waymark::slam
