#include "slam/camera/lens_options.h"

#include "slam/option_checks.h"

namespace waymark::slam {

void LensOptions::takeForGuess(bool fov_said) {
  given = false;
  prior = priorOfGuess(prior, fov_said, start);
}

std::string LensOptions::invalidReason() const {
  return firstReason({
      prior.invalidReason(),
      start.invalidReason(),
      firstUnmet({
          {first_keyframes >= 1 && max_keyframes >= 1, "a lens needs at least 1 keyframe"},
          {growth > 1.0, "the map must grow before the lens is estimated again"},
          {isNotNegative(min_chi2) && isNotNegative(min_change_chi2),
           "the chi-squares of a lens must not be negative"},
          {isPositive(learned_focal_share), "the sigma of a learned focal length must be positive"},
      }),
  });
}

}  // namespace waymark::slam
