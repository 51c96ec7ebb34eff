#include "slam/camera/lens_options.h"

#include <algorithm>

#include "slam/option_checks.h"

namespace waymark::slam {

std::string LensWatchOptions::invalidReason() const {
  return firstUnmet({
      {usual_frames >= 1 && late_frames >= 1.0, "a lens is watched over at least 1 frame"},
      {doubt_ratio > 1.0 && worst_fit > doubt_ratio,
       "the fit that puts a lens in doubt must be "
       "worse than the usual one"},
      {first_frames >= 1 && first_frames_unmeasured >= 1 &&
           max_frames >= std::max(first_frames, first_frames_unmeasured),
       "a lens needs at least 1 view"},
      {min_interval_ns >= 0 && isNotNegative(min_turn_rad),
       "the distance of two views of a lens must not be negative"},
      {isPositive(max_change), "the change of a focal length must be positive"},
      {isPositive(sure_rms), "the RMS of a lens that has surely changed must be positive"},
      {isPositive(cost_per_frame), "the cost of watching a lens must be positive"},
      {isShare(share_beside_loops), "a lens's share beside loops must be from 0 to 1"},
  });
}

void LensOptions::takeForGuess(bool fov_said) {
  given = false;
  prior = priorOfGuess(prior, fov_said, start);
}

std::string LensOptions::invalidReason() const {
  return firstReason({
      prior.invalidReason(),
      start.invalidReason(),
      watch.invalidReason(),
      firstUnmet({
          {first_keyframes >= 1 && max_keyframes >= 1, "a lens needs at least 1 keyframe"},
          {isNotNegative(urgent_cost), "the work of a lens in a frame must not be negative"},
          {growth > 1.0, "the map must grow before the lens is estimated again"},
          {isPositive(material_rms), "the RMS of a better lens must be positive"},
          {isNotNegative(min_chi2) && isNotNegative(agrees_chi2) && isNotNegative(min_change_chi2),
           "the chi-squares of a lens must not be negative"},
          {isNotNegative(better_known), "the share of a better known lens must not be negative"},
          {isPositive(learned_focal_share), "the sigma of a learned focal length must be positive"},
      }),
  });
}

}  // namespace waymark::slam
