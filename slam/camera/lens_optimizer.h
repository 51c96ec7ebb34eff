// The lens among the unknowns of the global optimization (seed 1, section 4.10, Eq. 41).
#pragma once

#include <string>

#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/bundle_adjuster.h"

namespace waymark::slam {

// How well a calibration is known, as sigmas; 0 keeps a parameter fixed.
struct IntrinsicPriors {
  double focal_px = 3.0;
  double centre_px = 3.0;
  double distortion = 0.01;  // of every coefficient

  [[nodiscard]] IntrinsicMatrix covariance() const;
  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// Where the intrinsics are expected, and how well that is known: as BundleProblem::Lens has it.
struct ExpectedLens {
  IntrinsicVector intrinsics = IntrinsicVector::Zero();
  IntrinsicMatrix covariance = IntrinsicMatrix::Zero();
};

// As optimizeGlobally(), with the intrinsics as unknowns (Eq. 41). On success *camera, which
// undistorted the map's corners, is the better lens, and undistorts them anew.
BundleSummary optimizeGloballyWithIntrinsics(Map* map, const MarkerOptions& markers,
                                             const ExpectedLens& expected, double readout_s,
                                             const BundleOptions& options, CameraModel* camera);

}  // namespace waymark::slam
