// The camera: intrinsics and lens distortion (seed 1, Eq. 8), in OpenCV's conventions.
//
// Pixel coordinates count pixel centres. "Normalized" coordinates are undistorted image-plane
// coordinates at z = 1: the SLAM works in them, so that the lens is dealt with once per corner.
#pragma once

#include <array>
#include <optional>
#include <string>

#include <Eigen/Core>

namespace waymark::slam {

enum class DistortionModel {
  // OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 (plumb_bob with the last ones zero; "rational").
  kRational,
  // Equidistant (Kannala-Brandt, OpenCV's fisheye): k1 k2 k3 k4 on theta.
  kEquidistant,
};

// What global optimization may change (delta of seed 1, Eq. 8): fx fy cx cy, then k1 k2 p1 p2 k3 of
// a rational lens or k1 k2 k3 k4 of an equidistant one, whose ninth entry is 0 and means nothing.
using IntrinsicVector = Eigen::Matrix<double, 9, 1>;
using IntrinsicMatrix = Eigen::Matrix<double, 9, 9>;
using IntrinsicJacobian = Eigen::Matrix<double, 2, 9>;

// The inverse of a covariance of intrinsics. What has no variance, and so is known exactly, gets a
// weight that no data outvotes.
inline constexpr double kExactInformation = 1e16;
[[nodiscard]] IntrinsicMatrix informationOf(IntrinsicMatrix covariance);

struct Calibration {
  int width = 0;                                  // pixels
  int height = 0;                                 // pixels
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;  // pixels
  DistortionModel model = DistortionModel::kRational;
  std::array<double, 8> distortion{};
  // Of the intrinsics (IntrinsicVector), the other coefficients being as they are; as whoever has
  // measured them says. Empty where nobody does.
  std::optional<IntrinsicMatrix> covariance{};

  friend bool operator==(const Calibration&, const Calibration&) = default;

  // Empty when usable, else the reason it is not.
  [[nodiscard]] std::string invalidReason() const;
};

class CameraModel {
 public:
  // Precondition: calibration.invalidReason() is empty.
  explicit CameraModel(const Calibration& calibration);

  [[nodiscard]] const Calibration& calibration() const { return c_; }
  [[nodiscard]] int width() const { return c_.width; }
  [[nodiscard]] int height() const { return c_.height; }
  // Geometric mean of fx and fy: pixels per unit of normalized coordinate at the centre.
  [[nodiscard]] double focalLength() const { return focal_; }

  // Normalized to pixel. Jacobian (2x2, d pixel / d normalized) where asked for.
  [[nodiscard]] Eigen::Vector2d distort(const Eigen::Vector2d& normalized,
                                        Eigen::Matrix2d* jacobian = nullptr) const;

  [[nodiscard]] IntrinsicVector intrinsics() const;
  // The same lens with other intrinsics, which nobody has measured.
  [[nodiscard]] Calibration withIntrinsics(const IntrinsicVector& intrinsics) const;
  // d pixel / d intrinsics of distort().
  [[nodiscard]] IntrinsicJacobian intrinsicJacobian(const Eigen::Vector2d& normalized) const;

  // Pixel to normalized, by Newton iteration to 1e-10. Empty where the model has no inverse there
  // (outside the lens's monotonic range, or 90 degrees and more off axis).
  [[nodiscard]] std::optional<Eigen::Vector2d> undistort(const Eigen::Vector2d& pixel) const;

  // Point in the camera frame to pixel. Empty behind the camera or outside the lens's range.
  [[nodiscard]] std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& p_c) const;

  [[nodiscard]] bool inImage(const Eigen::Vector2d& pixel, double margin_px = 0.0) const {
    return pixel.x() >= margin_px && pixel.y() >= margin_px &&
           pixel.x() <= c_.width - 1 - margin_px && pixel.y() <= c_.height - 1 - margin_px;
  }

  // Largest radius in normalized coordinates at which the distortion is still monotonic.
  [[nodiscard]] double maxRadius() const { return max_radius_; }

 private:
  Calibration c_;
  double focal_ = 0.0;
  double max_radius_ = 0.0;
};

}  // namespace waymark::slam
