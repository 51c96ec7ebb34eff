// The camera's readout time in use, as given or learned along with the map, and what it does to a
// frame's corners (rolling_shutter.h). Beyond seed 1.
#pragma once

#include <vector>

#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimisation/bundle_adjuster.h"
#include "slam/rolling_shutter/rolling_shutter.h"

namespace waymark::slam {

class Readout {
 public:
  Readout(const RollingShutterOptions& shutter, const MarkerOptions& markers)
      : shutter_(shutter),
        markers_(markers),
        seconds_(shutter.readout_s.value_or(shutter.learned_s)),
        next_keyframes_(shutter.first_keyframes) {}

  // First to last row; 0 for a global shutter.
  [[nodiscard]] double seconds() const { return seconds_; }

  // Moves the corners of a frame at T_w_c to where a global shutter would have seen them.
  void deskew(const CameraModel& camera, const Map& map, const Transform& T_w_c, const Twist& twist,
              std::vector<MarkerDetection>* detections) const;

  // Estimates the readout time anew when the map has grown enough since the last time. True when
  // another one is in use from here on: that moves the corners of every keyframe, and the map is
  // optimised anew.
  bool learn(const CameraModel& camera, const BundleOptions& optimisation, Map* map);

 private:
  RollingShutterOptions shutter_;
  MarkerOptions markers_;
  double seconds_;
  int next_keyframes_;  // it is estimated again when the map has so many
};

}  // namespace waymark::slam
