// Every decision constant of the SLAM, nested as its stages are. Each: meaning, unit, default, and
// what moving it trades.
#pragma once

#include <string>

#include "slam/detection/marker_detector.h"
#include "slam/initialisation/one_frame.h"
#include "slam/keyframes/keyframe_policy.h"
#include "slam/marker_pose/marker_resolver.h"
#include "slam/marker_pose/square_pose.h"
#include "slam/optimisation/bundle_adjuster.h"
#include "slam/relocalisation/relocaliser.h"
#include "slam/tracking/motion_model.h"
#include "slam/tracking/pose_optimiser.h"

namespace waymark::slam {

struct Options {
  // Side of the printed black square, metres. There is no sensible default.
  double marker_size_m = 0.0;

  DetectorOptions detector;
  InitialisationOptions initialisation;
  PoseOptimiserOptions tracking;
  MotionModelOptions motion;
  KeyframeOptions keyframes;
  MarkerResolverOptions marker_pose;
  RelocaliserOptions relocalisation;
  BundleOptions local_optimisation{.max_iterations = 5, .min_relative_decrease = 1e-3};
  BundleOptions global_optimisation{.max_iterations = 50, .min_relative_decrease = 1e-6};

  // Empty when usable, else which option is wrong and why.
  [[nodiscard]] std::string invalidReason() const;
};

}  // namespace waymark::slam
