// Joint optimisation of keyframe and marker poses: the solver behind local (seed 1, section 4.7)
// and global optimisation (section 4.10).
//
// Levenberg-Marquardt on Eq. 33 with Huber's kernel and the corners' covariances as weights. Every
// pose has 6 unknowns; the more numerous kind (keyframes or markers) is eliminated by the Schur
// complement, block by block, and the rest solved densely.
#pragma once

#include <vector>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

struct BundleOptions {
  int max_iterations = 10;
  // Stop when an iteration lowers the cost by less than this share of it.
  double min_relative_decrease = 1e-4;
  // Huber's threshold on a corner's whitened residual norm, in units of the noise.
  double huber = 2.45;
  // Take the noise from the residuals at the start (their median), where it exceeds what the
  // corners' covariances say; else from the covariances alone.
  bool estimate_noise = true;
};

struct BundleProblem {
  struct Pose {
    Transform T;  // T_w_c or T_w_m
    bool fixed = false;
  };
  struct Observation {
    int camera = 0;  // index into cameras
    int marker = 0;  // index into markers
    const MarkerDetection* detection = nullptr;
  };
  std::vector<Pose> cameras;
  std::vector<Pose> markers;
  std::vector<double> marker_sizes_m;  // as many as markers
  std::vector<Observation> observations;
};

struct BundleSummary {
  double initial_cost = 0.0;  // robust, whitened
  double final_cost = 0.0;
  int iterations = 0;
  // A step could not be computed (singular problem): the poses are the best found so far.
  bool failed = false;
};

// Improves the poses in place. At least one pose should be fixed, or the gauge floats (and is held
// by the damping only).
BundleSummary adjustBundle(BundleProblem* problem, const BundleOptions& options = {});

// The robust cost of the problem as it stands; infinite when a corner is behind its camera.
[[nodiscard]] double bundleCost(const BundleProblem& problem, const BundleOptions& options = {});

}  // namespace waymark::slam
