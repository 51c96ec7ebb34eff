// The lens among the unknowns of an optimization, while the map grows (Eq. 41 of seed 1, in
// slices).
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

#include "base/task.h"
#include "slam/camera/lens_evidence.h"
#include "slam/camera/lens_knowledge.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/bundle_adjuster.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam {

// What it most likely is, given keyframes and prior, how well that is known, and where the map is
// as seen through it.
struct LensEstimate {
  CameraModel camera;
  IntrinsicMatrix covariance = IntrinsicMatrix::Zero();
  MapCorrection correction;
  bool of_whole_map = false;
  // Of the corners, pixels: with the lens in use, and with this one.
  double rms_before_px = 0.0;
  double rms_after_px = 0.0;
  // For this one, beside the one in use; nothing where they hardly differ.
  LensEvidence evidence;
  // How much better a lens explains the corners where the markers may be elsewhere, too, as in a
  // map that is bent: chi-square. Infinite where that was not asked for.
  double chi2_beyond_bend = std::numeric_limits<double>::infinity();
  // Standard deviation of the focal length, as a share of it.
  [[nodiscard]] double focalShare() const {
    return std::sqrt(covariance(0, 0)) / camera.calibration().fx;
  }
};

struct LensProblem {
  CameraModel in_use;  // that undistorted the map's corners
  CameraModel expected;
  LensPrior prior;
  double readout_s = 0.0;      // that they were corrected with
  bool readout_known = false;  // else it is one more unknown, which would pass for a bent lens
  int max_keyframes = 100;     // the newest ones of a larger map
  // Nobody has measured it: it is expected without distortion, in whatever model, and the other one
  // is tried as well.
  bool any_model = false;
  // And as little is known of it so far that other minima may be better: they are looked for.
  bool any_beginning = false;
  // The markers are where they are: a map that is known.
  bool markers_held = false;
  // Unless they are not, and that is what looks like another lens: tried beside it.
  bool perhaps_bent = false;
  // An estimate that is no further than this from the lens in use after its first half, as
  // chi-square of the intrinsics, is not gone on with: it agrees. 0: none is.
  double agrees_chi2 = 0.0;
  // One that is further than this is held against the one in use, with the map as that has it best.
  double contradicts_chi2 = std::numeric_limits<double>::infinity();
  // The lens is that of the keyframes since then, nanoseconds (monotonic); no others take part.
  std::int64_t since_ns = std::numeric_limits<std::int64_t>::min();
};

// The map stays as it is. What is given by reference must outlive the task. Empty where there is no
// optimum, and where it agrees with the lens in use.
Task<std::optional<LensEstimate>> estimateLens(const Map& map, const MarkerOptions& markers,
                                               LensProblem lens, BundleOptions options,
                                               Budget* budget);

// All of the map through another lens, which is held, and how well it fits beside the one in use:
// both with the map as it is best through them.
struct LensComparison {
  MapCorrection correction;  // to the map through that lens
  double rms_in_use_px = 0.0;
  double rms_px = 0.0;
  // Of the corners' distances from where they were seen, pixels: what a few views of something else
  // do not decide.
  double median_in_use_px = 0.0;
  double median_px = 0.0;
  LensEvidence evidence;  // for the one in use
};

// As estimateLens(). Of LensProblem it needs the lens in use and the readout time.
Task<std::optional<LensComparison>> compareLens(const CameraModel& other, const Map& map,
                                                const MarkerOptions& markers, LensProblem lens,
                                                BundleOptions options, Budget* budget);

// How much an estimate differs from the lens in use: chi-square of the intrinsics; infinite where
// the models differ.
[[nodiscard]] double lensChange(const LensEstimate& estimate, const CameraModel& in_use);

}  // namespace waymark::slam
