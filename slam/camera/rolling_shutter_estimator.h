// The camera's readout time in use, as given or learned along with the map, and what it does to a
// frame's corners (rolling_shutter.h). Beyond seed 1.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "base/task.h"
#include "slam/camera/readout_estimate.h"
#include "slam/camera/rolling_shutter.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/twist.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam {

class RollingShutterEstimator {
 public:
  RollingShutterEstimator(const RollingShutterOptions& shutter, const MarkerOptions& markers);

  // First to last row; 0 for a global shutter.
  [[nodiscard]] double seconds() const { return seconds_; }

  // How well that is known, a standard deviation: 0 where it was given. One that is not believed,
  // though it was estimated, is a reason to doubt what is in use.
  [[nodiscard]] double sigma_s() const { return sigma_s_; }

  // By whoever knows: it is not learned.
  [[nodiscard]] bool isGiven() const { return shutter_.readout_s.has_value(); }

  // Moves the corners of a frame at T_w_c to where a global shutter would have seen them. Until the
  // readout time is estimated for the first time, what is not known of it is noise then.
  void deskew(const CameraModel& camera, const Map& map, const Transform& T_w_c, const Twist& twist,
              std::vector<MarkerDetection>* detections) const;

  // The same of a keyframe, whose motion is known otherwise by now.
  void deskew(const CameraModel& camera, KeyframeId keyframe, Map* map) const;

  // A slice of what is under way: an estimate, begun when the map has grown enough since the last
  // one; or, where that says what the map does not know yet, an optimization of the whole map. What
  // is given must outlive both.
  void work(double cost, const CameraModel& camera, const Map& map,
            const BundleOptions& optimization);
  // Puts what is done into the map. A readout time that is believed moves the corners of every
  // keyframe, and the first estimate, believed or not, ends the doubt in them. It is in use once
  // the whole map has been optimized with these: until then, poses and map are of the one before.
  // What that did to the newest keyframe taken part: T_new_old; empty when nothing has changed.
  std::optional<Transform> collect(const CameraModel& camera, const BundleOptions& optimization,
                                   Map* map);
  [[nodiscard]] bool isDone() const {
    return (estimate_ && estimate_->done()) || (whole_ && whole_->done());
  }
  // Nothing is under way or due.
  [[nodiscard]] bool idle(const Map& map) const { return !estimate_ && !whole_ && !isDue(map); }

 private:
  [[nodiscard]] bool isDue(const Map& map) const;
  // What corners are to be doubted for, a standard deviation of the readout time, seconds: in a
  // map that is not large enough yet to estimate it, or while that is done for the first time.
  [[nodiscard]] double doubt_s(const Map& map) const;
  // What the estimate that is done says, if the map is to follow.
  [[nodiscard]] std::optional<ReadoutEstimate> takeNews(const Map& map);
  // The optimization of the whole map as this readout shows it.
  void beginWhole(const ReadoutEstimate& readout, const CameraModel& camera,
                  const BundleOptions& optimization, const Map& map);

  RollingShutterOptions shutter_;
  MarkerOptions markers_;
  double seconds_;
  double sigma_s_;
  bool estimated_;      // or given, or learned before: no corner is doubted any more
  int next_keyframes_;  // it is estimated again when the map has so many
  std::optional<SlicedTask<std::optional<ReadoutEstimate>>> estimate_;
  // A readout time, and the map of an epoch as it shows it; and how that map is optimized.
  struct Adoption {
    ReadoutEstimate readout;
    std::uint64_t epoch;
    Map map;
  };
  std::optional<Adoption> adoption_;
  std::optional<SlicedTask<MapCorrection>> whole_;
};

}  // namespace waymark::slam
