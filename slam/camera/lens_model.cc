#include "slam/camera/lens_model.h"

#include <vector>

#include <Eigen/Cholesky>

namespace waymark::slam {
namespace {

struct Ray {
  Eigen::Vector2d normalized;
  Eigen::Vector2d pixel;
};

// Those pixels of a grid over the image that the lens has an inverse for.
std::vector<Ray> raysOf(const CameraModel& camera) {
  constexpr int kSteps = 16;
  std::vector<Ray> rays;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const Eigen::Vector2d pixel((camera.width() - 1.0) * i / kSteps,
                                  (camera.height() - 1.0) * j / kSteps);
      if (const auto normalized = camera.undistort(pixel)) rays.push_back({*normalized, pixel});
    }
  }
  return rays;
}

}  // namespace

CameraModel withoutDistortion(DistortionModel model, const CameraModel& guess) {
  Calibration c = guess.calibration();
  c.model = model;
  c.distortion = {};
  c.covariance.reset();
  return CameraModel(c);
}

std::optional<CameraModel> inModel(DistortionModel model, const CameraModel& camera) {
  if (camera.calibration().model == model) return camera;
  CameraModel found = withoutDistortion(model, camera);
  const std::vector<Ray> rays = raysOf(camera);
  constexpr int kIterations = 10;
  // Tangential coefficients say what the centre says, too; the ninth of an equidistant lens
  // nothing.
  constexpr double kHeld =
      1e-3;  // px^-2 of every unknown: too little to pull where anything is seen
  for (int i = 0; i < kIterations; ++i) {
    IntrinsicVector g = IntrinsicVector::Zero();
    Eigen::Matrix<double, 9, 9> H = kHeld * Eigen::Matrix<double, 9, 9>::Identity();
    for (const Ray& ray : rays) {
      const IntrinsicJacobian J = found.intrinsicJacobian(ray.normalized);
      H.noalias() += J.transpose() * J;
      g.noalias() += J.transpose() * (ray.pixel - found.distort(ray.normalized));
    }
    const Calibration next = found.withIntrinsics(found.intrinsics() + H.ldlt().solve(g));
    if (!next.invalidReason().empty()) return std::nullopt;
    found = CameraModel(next);
  }
  return found;
}

CameraModel asLens(const CameraModel& camera, const CameraModel& other) {
  return inModel(other.calibration().model, camera).value_or(other);
}

CameraModel expectedAs(const CameraModel& given, bool measured, const CameraModel& other) {
  return measured ? asLens(given, other) : withoutDistortion(other.calibration().model, given);
}

}  // namespace waymark::slam
