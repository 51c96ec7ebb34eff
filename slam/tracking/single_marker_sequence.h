// Which of its two poses a single marker was seen from (seed 1, section 3.2), for a whole sequence
// of frames that is over: SingleMarkerJudge in both directions. Each frame is at one of its poses;
// what the images say, and how far a camera moves from one frame to the next, is added up over all
// ways through the sequence (forward-backward algorithm; Rabiner, "A tutorial on hidden Markov
// models", 1989, section III). Frames with several markers are at one pose only, and decide for
// their neighbours before and after.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "slam/geometry/transform.h"
#include "slam/tracking/single_marker.h"

namespace waymark::slam {

struct SingleMarkerSequenceOptions {
  // As of live frames. max_log_odds: the most that is believed of one image, or of one step.
  SingleMarkerOptions judge{};
  // Odds from which an undecided frame has a pose at all, with the other one in its covariance;
  // below there is none. 3 is one in twenty.
  double min_pose_log_odds = 3.0;
  // How fast a camera usually is, standard deviations: metres and radians per second. Less believes
  // more of what neighbours say, and errs when somebody is faster.
  double speed_m_s = 1.0;
  double turn_rad_s = 1.5;
  // What the map and the lens leave open between two frames of different markers, metres and
  // radians.
  double place_sigma_m = 0.01;
  double place_sigma_rad = 0.01;
  // A step says no more against a pose than this chi-square (6 dimensions): an error has longer
  // tails than its covariance. More decides sooner, and wrongly when both poses are far off.
  double max_step_chi2 = 30.0;

  // The ambiguity ratio that is told of a decided pose is at least this, and of any other less:
  // tau_e of seed 1, as RelocalizerOptions::ambiguity_ratio.
  double decided_ratio = 3.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct SequenceFrame {
  std::int64_t time_ns = 0;
  int poses = 0;    // 0: it says nothing; 1: it is there; 2: at one of the two
  int marker = -1;  // that the two are of
  std::array<Transform, 2> T_w_c{};
  std::array<Matrix6d, 2> covariance{};  // of (dp, dtheta): metres, radians, world frame
  // Of two: what the image says for the first, as the logarithm of its odds.
  double log_odds = 0.0;
  // Of two: SingleMarkerView's. Below judge.min_barrier they are not two, and say nothing of
  // others.
  double barrier = 0.0;
};

// For each frame the odds of its first pose over the second, as their logarithm, given all frames;
// 0 where it has not two poses that are distinct.
[[nodiscard]] std::vector<double> logOddsOfFirst(std::span<const SequenceFrame> frames,
                                                 const SingleMarkerSequenceOptions& options);

}  // namespace waymark::slam
