// The lens of a camera that nobody has calibrated, from the squares in its first frames: each is
// the image of a plane whose shape is known, and says a little of the focal length as soon as it is
// tilted (Zhang's method, with every square a board of its own). Good enough for a map to begin,
// which learns the rest (lens_estimator.h).
#pragma once

#include <cmath>
#include <deque>
#include <optional>
#include <span>
#include <string>

#include "slam/camera/lens_knowledge.h"
#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/bundle_adjuster.h"

namespace waymark::slam {

struct LensStartOptions {
  // Of a camera that is not known, as a share of the image's width: the width's field of view is 61
  // degrees, and two standard deviations reach from 35 to 118.
  double likely_focal = 0.85;
  double focal_share = 0.35;
  // Of one whose field of view somebody has said.
  double said_focal_share = 0.05;
  // The map begins as soon as the focal length is known this well, as a share of it ...
  double enough_share = 0.04;
  // ... or when this many frames with markers have said no more. Most scenes say more when
  // markers are seen from several places, for which there has to be a map.
  int frames = 6;
  // How much better a fisheye (equidistant) has to explain the squares than a usual lens before it
  // is taken for one: twice the log of their likelihoods.
  double model_evidence = 12.0;
  // Squares that take part, the newest ones. More are surer, and cost time in each of these frames.
  int views = 40;
  BundleOptions optimization{
      .max_iterations = 20, .estimate_residual_sigma = false, .view_chi2 = 0.0};

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// What the camera is taken for before anything was seen: square pixels, no distortion, the centre
// in the middle. fov_deg: of the image's width, as somebody has said it.
[[nodiscard]] CameraModel guessedCamera(int width, int height, std::optional<double> fov_deg,
                                        const LensStartOptions& options);

// How well such a camera is known.
[[nodiscard]] inline LensPrior priorOfGuess(LensPrior prior, bool fov_said,
                                            const LensStartOptions& options) {
  prior.focal_share = fov_said ? options.said_focal_share : options.focal_share;
  return prior;
}

struct StartingLens {
  CameraModel camera;
  IntrinsicMatrix covariance = IntrinsicMatrix::Zero();
  [[nodiscard]] double focalShare() const {
    return std::sqrt(covariance(0, 0)) / camera.calibration().fx;
  }
};

class LensStart {
 public:
  // guess: see guessedCamera(); its focal length is known as well as `prior` says.
  LensStart(const CameraModel& guess, const LensPrior& prior, const MarkerOptions& markers,
            const LensStartOptions& options)
      : guess_(guess), prior_(prior), markers_(markers), options_(options) {}

  // The next frame. The lens once it is known well enough for a map to begin.
  [[nodiscard]] std::optional<StartingLens> process(std::span<const MarkerDetection> detections);

 private:
  struct View {
    MarkerDetection detection;
    double size_m = 0.0;
  };

  [[nodiscard]] std::optional<StartingLens> bestLens() const;
  [[nodiscard]] std::optional<StartingLens> estimate(const CameraModel& from, double* cost) const;

  CameraModel guess_;
  LensPrior prior_;
  MarkerOptions markers_;
  LensStartOptions options_;
  std::deque<View> views_;
  int frames_ = 0;
};

}  // namespace waymark::slam
