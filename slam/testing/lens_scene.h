// A map seen through a lens that is not the one it is taken for.
#pragma once

#include <random>
#include <vector>

#include <Eigen/Cholesky>

#include "slam/camera/lens_knowledge.h"
#include "slam/camera/lens_start.h"
#include "slam/camera/undistort_map.h"
#include "slam/testing/scene.h"

namespace waymark::slam::testing {

inline constexpr double kLensSceneSize = 0.15;

// A walk along a wall of tilted markers, near enough that they come to the corners of the image.
inline Map lensScene(const CameraModel& truth, double sigma_px, std::mt19937* rng) {
  const std::vector<SyntheticMarker> markers = markerWall(3, 6, 0.5, rng);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  std::vector<Transform> views;
  for (int i = 0; i < 14; ++i) {
    const double x = 0.22 * (i - 7);
    const Eigen::Vector3d eye(x, 1.2 + 0.4 * u(*rng), 0.3 * u(*rng));
    views.push_back(lookAt(eye, {0.6 * x + 0.4 * u(*rng), 3.0, 0.3 * u(*rng)}));
  }
  return trueMap(truth, views, markers, kLensSceneSize, sigma_px, rng);
}

// 120 degrees wide, and what it was taken for after six frames of a room, by somebody who had no
// calibration: of the other model, with a focal length that is known to about a quarter.
inline CameraModel wideLens() {
  Calibration c = testCalibration();
  c.fx = c.fy = 305.6;
  c.model = DistortionModel::kEquidistant;
  c.distortion = {-0.011, 0.003};
  return CameraModel(c);
}
inline CameraModel wideLensAtFirst(LensKnowledge* knowledge) {
  const LensStartOptions start;
  const Calibration wide = wideLens().calibration();
  *knowledge = {.given = guessedCamera(wide.width, wide.height, {}, start)};
  Calibration c = knowledge->given.calibration();
  c.fx = c.fy = 285.0;
  c.distortion = {-0.161, 0.007, 0.0, 0.0, 0.061};
  IntrinsicMatrix covariance = IntrinsicMatrix::Identity();
  covariance.topLeftCorner<2, 2>() *= (0.27 * c.fx) * (0.27 * c.fx);
  knowledge->adopt(CameraModel(c), covariance, 0.0, 0.0, LensPrior{}, 0.0);
  return CameraModel(c);
}

// Another lens of the same kind, as far off as the prior has it.
inline CameraModel drawnLens(const CameraModel& truth, const LensPrior& prior, std::mt19937* rng) {
  std::normal_distribution<double> normal;
  IntrinsicVector n;
  for (double& v : n) v = normal(*rng);
  const Eigen::LLT<IntrinsicMatrix> cholesky(prior.covariance(truth));
  return CameraModel(truth.withIntrinsics(truth.intrinsics() + cholesky.matrixL() * n));
}

}  // namespace waymark::slam::testing
