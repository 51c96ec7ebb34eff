// How the lens is learned.
#pragma once

#include <string>

#include "slam/camera/lens_knowledge.h"
#include "slam/camera/lens_start.h"

namespace waymark::slam {

struct LensOptions {
  // Off: the calibration is exact, whatever the markers say.
  bool learn = true;
  // Off: there is no calibration, the camera given is a guess, and a map begins once squares have
  // said more.
  bool given = true;
  LensPrior prior;
  // Of a camera that was not given.
  LensStartOptions start;
  // It is estimated when a map has this many keyframes, and again whenever the map has grown by the
  // factor, from the newest ones of them, at most so many. Each time costs an optimization of those.
  int first_keyframes = 3;
  double growth = 1.4;
  int max_keyframes = 100;
  // An estimate is believed instead of the lens in use when it differs from it by this much:
  // chi-square of the intrinsics, by their covariance. 28 is the 99.9 % quantile of the nine; but
  // paper that is not flat and shutters that roll look like a little of a wrong lens. Smaller takes
  // every whim of the paper for the lens, larger believes a wrong calibration for longer.
  double min_chi2 = 60.0;
  // The same of a lens that was learned before, which a better estimate replaces.
  double min_change_chi2 = 30.0;
  // It counts as learned when the focal length's standard deviation is at most this share of it.
  double learned_focal_share = 0.002;

  // There is no calibration. fov_said: somebody has told the guess its field of view.
  void takeForGuess(bool fov_said);

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

}  // namespace waymark::slam
