// How a map begins (seed 1, section 4.1): one-frame and two-frame initialization side by side.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "slam/initialization/one_frame.h"
#include "slam/initialization/two_frame.h"
#include "slam/map/map.h"
#include "slam/no_pose_reason.h"

namespace waymark::slam {

struct InitializationOptions {
  // tau_e of Eq. 14: how much worse a marker's other pose must fit for it to start a map alone.
  // Larger starts later, smaller may start from the wrong one.
  double ambiguity_ratio = 3.0;
  // Least likeness of a marker to its print (code_likeness.h) for it to start a map alone: what is
  // none is seldom read twice. Larger starts later where markers are small and blurred.
  double min_likeness = 0.85;
  // n: after this many frames without a start, f^0 is replaced by the newest one. Too few never
  // reach a baseline, too many hold on to a frame with nothing in common.
  int attempts = 60;
  TwoFrameOptions two_frame;
  SquarePoseOptions square;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// The first keyframes, of which the first is the world, and the markers that have a pose.
struct Start {
  std::vector<Keyframe> keyframes;  // one or two
  std::vector<InitialMarker> markers;
};

class Initializer {
 public:
  Initializer(const MarkerOptions& markers, double focal_px, const InitializationOptions& options)
      : markers_(markers), focal_px_(focal_px), options_(options) {}

  // The next frame (its pose is not looked at). Empty while nothing can start yet; reason() then
  // says why.
  [[nodiscard]] std::optional<Start> process(const Keyframe& frame);
  [[nodiscard]] NoPoseReason reason() const { return reason_; }

 private:
  [[nodiscard]] std::optional<Start> fromTwoFrames(const Keyframe& frame);

  MarkerOptions markers_;
  double focal_px_;
  InitializationOptions options_;
  std::optional<Keyframe> first_;  // f^0
  int attempts_ = 0;               // frames tried against it
  NoPoseReason reason_ = NoPoseReason::kNone;
};

}  // namespace waymark::slam
