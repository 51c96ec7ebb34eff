// Every decision constant of the SLAM, nested as its stages are. Each: meaning, unit, default, and
// what moving it trades.
#pragma once

#include <string>

#include "slam/camera/lens_optimizer.h"
#include "slam/camera/lens_options.h"
#include "slam/camera/rolling_shutter.h"
#include "slam/covariance/map_covariance.h"
#include "slam/detection/search/marker_follower.h"
#include "slam/initialization/initializer.h"
#include "slam/loop_closure/loop_closer.h"
#include "slam/map/marker_options.h"
#include "slam/mapping/mapper.h"
#include "slam/marker_screening/marker_screening.h"
#include "slam/natural/pose_integrator.h"
#include "slam/pieces/piece_options.h"
#include "slam/tracking/tracker.h"

namespace waymark::slam {

struct Options {
  MarkerOptions markers;
  // Off: the map given at the start is used and stays as it is, bit for bit.
  bool mapping = true;

  DetectorOptions detector;
  FollowerOptions follower;
  InitializationOptions initialization;
  TrackerOptions tracking;
  MapperOptions mapper;
  LoopOptions loops;
  MarkerScreeningOptions screening;
  RollingShutterOptions shutter;
  LensOptions lens;
  MapCovarianceOptions covariance;
  NaturalOptions natural;
  PieceOptions pieces;
  // What a frame may spend on optimizations and loop closures, which go on over as many frames as
  // they take: counted, not timed, a unit being what took a microsecond on a core of 3 GHz. More is
  // done sooner, less is steadier.
  double work_per_frame = 150.0;
  // Of the time that a camera leaves which is slower than 30 Hz, this share is spent beside it, up
  // to so many units in a frame: at 2 Hz a map would be built upon for minutes before it is
  // optimized, or a wrong marker is taken out of it. More makes that frame's pose later.
  double spare_time_share = 0.03;
  double most_work_per_frame = 20'000.0;
  BundleOptions global_optimization{.max_iterations = 50, .min_relative_decrease = 1e-6};
  IntrinsicPriors intrinsics;

  // For images that are no sequence: nothing is followed, predicted or carried from one to the
  // next, and no work is left for the next one. Pictures are those found in the image itself
  // (FrameInput::found).
  void treatAsUnorderedImages();

  // Empty when usable, else which option is wrong and why.
  [[nodiscard]] std::string invalidReason() const;
};

}  // namespace waymark::slam
