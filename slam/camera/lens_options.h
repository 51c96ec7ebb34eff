// How the lens is learned.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "slam/camera/lens_knowledge.h"
#include "slam/camera/lens_start.h"

namespace waymark::slam {

// How a change of the lens under way is noticed, and the lens learned in a map that does not grow.
struct LensWatchOptions {
  // Frames with at least two markers of the map: so many are usual, and so many are of late.
  int usual_frames = 100;
  double late_frames = 10.0;
  // The lens is in doubt when the markers fit this many times worse of late than usually (mean
  // squares), or than this where they usually fit better than the noise has it; and a fit counts as
  // this bad at most. Smaller takes a bend in the map for the lens.
  double doubt_ratio = 2.0;
  double least_usual = 0.5;
  double worst_fit = 100.0;
  // Views it is learned from: the first time with so many, or with so many if nobody has measured
  // it (whatever is known then is better than what is in use); then with twice as many, and at
  // most.
  int first_frames = 8;
  int first_frames_unmeasured = 3;
  int max_frames = 32;
  // From one to the next at least: nanoseconds, and radians (of a turn, or of a way as seen from
  // the markers).
  std::int64_t min_interval_ns = 60'000'000;
  double min_turn_rad = 0.02;
  // While the map grows, a focal length that changes by more than this share of it is no change of
  // focus (an autofocus breathes by some per cent) but a map that is bent. Larger takes bends for
  // the lens, smaller misses what long lenses do close by.
  double max_change = 0.1;
  // While the map grows, corners have to fit by so much better, on top of
  // LensOptions::material_rms: a bend looks a little like another lens, too.
  double sure_rms = 0.75;
  // What an estimate may spend of a frame, in the units of Options::work_per_frame. More knows the
  // lens sooner, and makes those frames longer.
  double cost_per_frame = 400.0;
  // While a loop is being closed, which may look like another lens, it gets this share of that.
  double share_beside_loops = 0.2;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

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
  // factor, from the newest ones of them, at most so many. Each time costs an optimization of
  // those.
  int first_keyframes = 3;
  double growth = 1.4;
  int max_keyframes = 100;
  // A map of fewer keyframes than this is built on sand if the lens is wrong: its estimates may
  // spend so much of a frame, in the units of Options::work_per_frame, and what is left of that
  // later.
  int urgent_keyframes = 40;
  double urgent_cost = 1200.0;
  // An estimate is believed instead of the lens in use when it differs from it by this much:
  // chi-square of the intrinsics, by their covariance. 28 is the 99.9 % quantile of the nine; but
  // paper that is not flat and shutters that roll look like a little of a wrong lens. Smaller takes
  // every whim of the paper for the lens, larger believes a wrong calibration for longer.
  double min_chi2 = 60.0;
  // A calibration that was given and is within that quantile after a first look is right: it is
  // looked at no closer, and again when the map has grown by the factor twice. Larger saves more
  // work, and sees less of what is wrong; 0: each estimate is finished.
  double agrees_chi2 = 28.0;
  // And only if the corners' RMS falls to this share of what it was: a calibration that is as good
  // as the corners are is left alone. Smaller keeps calibrations that are a little wrong. Not asked
  // of what agrees with a calibration that says how well it was measured: the map measures it
  // better, and would bend by what was left open. Nor where min_chi2 is reached also if each marker
  // and each keyframe has errors of its own (LensEvidence): half a per cent of focal length drowns
  // in the noise of an image (an RMS of 0.96), and bends the map eightfold.
  double material_rms = 0.8;
  // And from so many views on: of fewer a blur or a rolling shutter, which is learned from as many,
  // says as much.
  std::size_t views_against_given = 8;
  // The same of a lens that was learned before, which a better estimate replaces ...
  double min_change_chi2 = 15.0;
  // ... and so does one that knows the focal length to this share of the standard deviation that
  // was known before. Smaller keeps what the first seconds have told, larger moves the map more
  // often.
  double better_known = 0.6;
  LensWatchOptions watch;
  // It counts as learned when the focal length's standard deviation is at most this share of it.
  double learned_focal_share = 0.002;

  // There is no calibration. fov_said: somebody has told the guess its field of view.
  void takeForGuess(bool fov_said);

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

}  // namespace waymark::slam
