// Exact synthetic observations for the unit tests: no images, corners projected from known poses.
#pragma once

#include <optional>
#include <random>
#include <vector>

#include <Eigen/LU>

#include "slam/camera_pose/known_marker.h"
#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"

namespace waymark::slam::testing {

inline Calibration testCalibration() {
  Calibration c{.width = 640, .height = 480, .fx = 520.0, .fy = 521.0, .cx = 318.0, .cy = 242.0};
  c.distortion = {-0.2, 0.05, 3e-4, -2e-4, 0.0};
  return c;
}

// A camera at `eye` that looks at `target`, its x axis level when the world's z is up.
inline Transform lookAt(const Eigen::Vector3d& eye, const Eigen::Vector3d& target) {
  const Eigen::Vector3d z = (target - eye).normalized();
  Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitZ());
  if (x.norm() < 1e-6) x = Eigen::Vector3d::UnitX();
  x.normalize();
  Transform T;
  T.R << x, z.cross(x), z;
  T.p = eye;
  return T;
}

// A marker at `centre` whose print faces `towards`.
inline Transform markerFacing(const Eigen::Vector3d& centre, const Eigen::Vector3d& towards) {
  const Eigen::Vector3d z = (towards - centre).normalized();
  Eigen::Vector3d x = Eigen::Vector3d::UnitZ().cross(z);
  if (x.norm() < 1e-6) x = Eigen::Vector3d::UnitX();
  x.normalize();
  Transform T;
  T.R << x, z.cross(x), z;
  T.p = centre;
  return T;
}

// The marker as the camera sees it, each corner moved by Gaussian noise of sigma_px; the covariance
// says sigma_px (or 0.05 pixels for exact corners). Empty when it is not wholly in the image or
// seen from behind.
inline std::optional<MarkerDetection> observe(const CameraModel& camera, const Transform& T_w_c,
                                              int id, const Transform& T_w_m, double size_m,
                                              double sigma_px, std::mt19937* rng) {
  if ((T_w_c.p - T_w_m.p).dot(T_w_m.R.col(2)) <= 0.0) return std::nullopt;
  MarkerDetection detection;
  detection.id = id;
  const auto corners = markerCorners(size_m);
  std::normal_distribution<double> noise(0.0, 1.0);
  for (std::size_t k = 0; k < 4; ++k) {
    const auto pixel = camera.project(T_w_c.inverse() * (T_w_m * corners[k]));
    if (!pixel || !camera.inImage(*pixel, 2.0)) return std::nullopt;
    detection.pixels[k] = *pixel + sigma_px * Eigen::Vector2d(noise(*rng), noise(*rng));
    const auto normalized = camera.undistort(detection.pixels[k]);
    if (!normalized) return std::nullopt;
    detection.normalized[k] = *normalized;
    Eigen::Matrix2d J;
    (void)camera.distort(*normalized, &J);
    const double sigma = sigma_px > 0.0 ? sigma_px : 0.05;
    detection.covariance[k] = sigma * sigma * (J.transpose() * J).inverse();
  }
  return detection;
}

struct SyntheticMarker {
  int id;
  Transform T_w_m;
};

// Every marker the camera sees, sorted by id.
inline std::vector<MarkerDetection> observeAll(const CameraModel& camera, const Transform& T_w_c,
                                               const std::vector<SyntheticMarker>& markers,
                                               double size_m, double sigma_px, std::mt19937* rng) {
  std::vector<MarkerDetection> detections;
  for (const SyntheticMarker& marker : markers) {
    auto seen = observe(camera, T_w_c, marker.id, marker.T_w_m, size_m, sigma_px, rng);
    if (seen) detections.push_back(*seen);
  }
  return detections;
}

// A detection as a map knows it that has the marker there. The detection must outlive it.
inline KnownMarker knownMarker(const MarkerDetection& detection, const Transform& T_w_m,
                               double size_m, const Matrix6d& covariance = Matrix6d::Zero()) {
  KnownMarker marker{&detection, T_w_m, size_m, covariance, markerCorners(size_m)};
  for (Eigen::Vector3d& corner : marker.corners_w) corner = T_w_m * corner;
  return marker;
}

// The detections as a map that holds the truth knows them. The ids are indices into `markers`.
inline std::vector<KnownMarker> knownFrom(const std::vector<MarkerDetection>& detections,
                                          const std::vector<SyntheticMarker>& markers,
                                          double size_m) {
  std::vector<KnownMarker> known;
  for (const MarkerDetection& detection : detections) {
    const Transform& T_w_m = markers[static_cast<std::size_t>(detection.id)].T_w_m;
    known.push_back(knownMarker(detection, T_w_m, size_m));
  }
  return known;
}

// A wall of rows x columns markers in the plane y = 3, facing -y, each tilted a little.
inline std::vector<SyntheticMarker> markerWall(int rows, int columns, double spacing_m,
                                               std::mt19937* rng) {
  std::uniform_real_distribution<double> tilt(-0.5, 0.5);
  std::vector<SyntheticMarker> markers;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const Eigen::Vector3d centre(spacing_m * (c - 0.5 * (columns - 1)), 3.0,
                                   spacing_m * (r - 0.5 * (rows - 1)));
      const Eigen::Vector3d towards = centre + Eigen::Vector3d(tilt(*rng), -1.0, tilt(*rng));
      markers.push_back({r * columns + c, markerFacing(centre, towards)});
    }
  }
  return markers;
}

}  // namespace waymark::slam::testing
