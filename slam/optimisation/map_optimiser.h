// Local and global optimisation of the map (seed 1, sections 4.7 and 4.10).
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimisation/bundle_adjuster.h"

namespace waymark::slam {

// How well a calibration is known, as sigmas; 0 keeps a parameter fixed.
struct IntrinsicPriors {
  double focal_px = 3.0;
  double centre_px = 3.0;
  double distortion = 0.01;  // of every coefficient

  [[nodiscard]] IntrinsicVector sigmas() const;
};

// Section 4.7: optimises the keyframes that share a marker with the given one (Eq. 30) and the
// markers they see (Eq. 31); other keyframes that see those markers take part, fixed (Eq. 32).
// What fixes the world (`markers`: an origin marker, anchors, or else the first keyframe) does not
// move. Precondition: the keyframe exists.
BundleSummary optimiseLocally(Map* map, KeyframeId keyframe, const MarkerOptions& markers,
                              const BundleOptions& options);

// Section 4.10: all keyframes and all posed markers.
BundleSummary optimiseGlobally(Map* map, const MarkerOptions& markers,
                               const BundleOptions& options);
// The same with the intrinsics as unknowns (Eq. 41), expected where the calibration has them. On
// success *camera, which undistorted the map's corners, is the better lens, and undistorts them
// anew.
BundleSummary optimiseGloballyWithIntrinsics(Map* map, const MarkerOptions& markers,
                                             const IntrinsicVector& expected,
                                             const IntrinsicPriors& priors, double readout_s,
                                             const BundleOptions& options, CameraModel* camera);

// The readout time among the unknowns: what it most likely is, given the newest keyframes, and how
// well that is known.
struct ReadoutEstimate {
  double readout_s = 0.0;
  double sigma_s = 0.0;
};
// The map's corners are corrected with readout_s; the map stays as it is. keyframes: how many take
// part at most. Empty when nothing in them depends on it (a camera that hardly moved).
[[nodiscard]] std::optional<ReadoutEstimate> estimateReadout(
    const Map& map, const MarkerOptions& markers, double readout_s, const CameraModel& camera,
    int keyframes, const BundleOptions& options);

// How well the posed markers explain what keyframes saw.
struct MapFit {
  // Squared whitened errors of the corners; all infinite when one is behind its camera.
  std::vector<double> squared;
  double noise = 1.0;  // standard deviation of the whitened residuals, at least 1

  // huber: the kernel's threshold, in units of the corners' covariances.
  [[nodiscard]] double cost(double huber) const;
  // Per corner; 0 without any.
  [[nodiscard]] double meanCost(double huber) const;
};
[[nodiscard]] MapFit fitOf(const Map& map);
// Of some keyframes only. Precondition: they exist.
[[nodiscard]] MapFit fitOf(const Map& map, std::span<const KeyframeId> keyframes);

}  // namespace waymark::slam
