// The lens by frames that a map explains: of a map that is only localized in, and where a
// lens has changed under way (an autofocus, a knock): then all markers in view fit far worse than
// they did, at once.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>

#include "base/task.h"
#include "slam/camera/lens_estimate.h"
#include "slam/camera/lens_knowledge.h"
#include "slam/camera/lens_options.h"
#include "slam/camera/rolling_shutter_estimator.h"
#include "slam/camera_pose/known_marker.h"
#include "slam/frame_time.h"
#include "slam/geometry/twist.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/bundle_adjuster.h"

namespace waymark::slam {

class LensWatch {
 public:
  // map_grows: the map itself learns the lens, and this one only looks for a change. All must
  // outlive it.
  LensWatch(const LensOptions& options, const MarkerOptions& markers, bool map_grows,
            CameraModel* camera, LensKnowledge* knowledge)
      : options_(options),
        markers_(markers),
        map_grows_(map_grows),
        camera_(camera),
        knowledge_(knowledge) {}

  // A frame with a pose, and the markers of the map that it was found from.
  void look(const FrameTime& time, const Transform& T_w_c, const Twist& twist,
            std::span<const KnownMarker> known);
  // A slice of an estimate under way, or due.
  void work(double cost, const RollingShutterEstimator& shutter, const BundleOptions& optimization);
  // Whether another lens is in use from here on. What it undistorted is the caller's to do again:
  // all since LensKnowledge::since_ns.
  [[nodiscard]] bool collect(const RollingShutterEstimator& shutter);

  // Coordinates have changed, or the lens: what was seen so far is of no use.
  void forget();

 private:
  // The lens is known, from somebody or from the map while it grows: else it is measured here.
  [[nodiscard]] bool looksForChange() const { return map_grows_ || options_.given; }
  [[nodiscard]] int firstFrames() const {
    return looksForChange() ? options_.watch.first_frames : options_.watch.first_frames_unmeasured;
  }
  // It is estimated from so many views at most: from more where what few say contradicts a
  // calibration, and is not enough to take its place.
  [[nodiscard]] int maxFrames() const {
    constexpr int kUndecided = 4;
    return (is_undecided_ ? kUndecided : 1) * options_.watch.max_frames;
  }
  [[nodiscard]] int nextFrames() const {
    return estimated_from_ == 0 ? firstFrames() : std::min(2 * estimated_from_, maxFrames());
  }
  // Views are collected, and the lens is estimated from them: until the map, which is known, has
  // said what it can, and again when the lens is in doubt.
  [[nodiscard]] bool asks() const {
    return doubted_since_ns_ > 0 || !(map_grows_ || estimated_from_ >= maxFrames());
  }
  void noteFit(const FrameTime& time, const Transform& T_w_c, std::span<const KnownMarker> known);
  [[nodiscard]] bool isAnotherView(const FrameTime& time, const Transform& T_w_c,
                                   std::span<const KnownMarker> known) const;
  [[nodiscard]] bool believes(const LensEstimate& estimate) const;
  void seeAgain();

  LensOptions options_;
  MarkerOptions markers_;
  bool map_grows_;
  CameraModel* camera_;
  LensKnowledge* knowledge_;
  // How badly the markers fit, as a chi-square of each corner coordinate: for long, and of late.
  double usual_ = 1.0;
  double of_late_ = 1.0;
  int frames_ = 0;
  std::int64_t doubted_since_ns_ = 0;  // 0: nobody doubts the lens
  Map seen_;                           // frames as keyframes, and the markers, held
  int estimated_from_ = 0;             // so many of them, the last time
  int times_seen_ = 0;                 // anew, through a better lens
  bool is_undecided_ = false;  // the last estimate contradicts the lens, and is not believed
  std::optional<SlicedTask<std::optional<LensEstimate>>> estimate_;
};

}  // namespace waymark::slam
