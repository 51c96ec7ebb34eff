// A run's poses, frame after frame, against the truth: what bench gaps measures in it.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "simulator/simulation.h"
#include "slam/frame.h"
#include "slam/geometry/transform.h"
#include "slam/pose_estimate.h"
#include "tests/bench/gap_report.h"

namespace waymark::bench {

// The frames of the way until it turns back: half of them where the camera ends where it began,
// otherwise all.
[[nodiscard]] std::int64_t firstWay(const simulator::Simulation& simulation);

class GapFollower {
 public:
  explicit GapFollower(GapReport* report) : report_(report) {}

  // T_w_scene: the map's world and the scene's, by the first keyframe and by the last marker.
  void add(double time_s, const slam::FrameResult& result, const slam::Transform& T_scene_c,
           const slam::Transform& T_w_scene, const slam::Transform& T_w_scene_by_marker);

 private:
  struct Place {
    slam::Transform estimate;
    slam::Transform truth;
  };
  // The last pose from markers.
  struct Start {
    slam::PoseEstimate pose;
    slam::Transform truth;
  };
  // Of a frame that has a pose; empty where its covariance is none.
  [[nodiscard]] std::optional<Carried> compare(const slam::PoseEstimate& pose,
                                               const slam::Transform& truth,
                                               const slam::Transform& truth_by_marker) const;
  void extend(double time_s, const slam::FrameResult& result, const slam::Transform& truth,
              const std::optional<Carried>& now);
  void close(const slam::Transform& estimate, const slam::Transform& truth);

  GapReport* report_;
  bool is_beyond_ = false;
  bool is_position_beyond_ = false;
  std::optional<Gap> gap_;
  std::optional<Start> start_;
  Place before_;  // the frame before
};

}  // namespace waymark::bench
