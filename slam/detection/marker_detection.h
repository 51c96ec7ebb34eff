// What the detector sees: one marker in one frame.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include <Eigen/Core>

namespace waymark::slam {

class CameraModel;

// Corner order everywhere: top-left, top-right, bottom-right, bottom-left of the upright print.
// The omega of seed 1, Eq. 10, with a covariance for each corner.
struct MarkerDetection {
  int id = -1;
  int hamming = 0;        // corrected bits of the code
  double likeness = 1.0;  // how much it looks like its print (code_likeness.h), 0 to 1
  std::array<Eigen::Vector2d, 4> pixels = zeros<Eigen::Vector2d>();      // distorted, pixel centres
  std::array<Eigen::Vector2d, 4> normalized = zeros<Eigen::Vector2d>();  // undistorted, at z = 1
  // Of `normalized`, in its squared units: the image's noise, and ...
  std::array<Eigen::Matrix2d, 4> covariance = zeros<Eigen::Matrix2d>();
  // ... how far a readout time that nobody knows yet may have moved the corners, normalized: a
  // standard deviation, zero where it is less than the noise or known (rolling_shutter.h).
  std::array<Eigen::Vector2f, 4> readout_doubt = zeros<Eigen::Vector2f>();

  // A corner's covariance by the image's noise alone.
  [[nodiscard]] Eigen::Matrix2d noise(std::size_t corner) const {
    const Eigen::Vector2d doubt = readout_doubt[corner].cast<double>();
    return covariance[corner] - doubt * doubt.transpose();
  }
  [[nodiscard]] bool isDoubted() const {
    return !std::ranges::all_of(readout_doubt,
                                [](const auto& doubt) { return doubt.isZero(0.0F); });
  }
  void trustReadout() {
    for (std::size_t k = 0; k < 4; ++k) {
      covariance[k] = noise(k);
      readout_doubt[k].setZero();
    }
  }

 private:
  template <typename T>
  [[nodiscard]] static std::array<T, 4> zeros() {
    return {T::Zero(), T::Zero(), T::Zero(), T::Zero()};
  }
};

// Normalized corners of pixels. Empty when one is outside the lens's range.
[[nodiscard]] std::optional<std::array<Eigen::Vector2d, 4>> undistortCorners(
    const CameraModel& camera, const std::array<Eigen::Vector2d, 4>& pixels);
// `normalized` from `pixels`. False when a corner is outside the lens's range; the detection then
// stays as it is.
[[nodiscard]] bool undistortCorners(const CameraModel& camera, MarkerDetection* detection);

// Those of one id stay in their order.
void sortById(std::vector<MarkerDetection>* detections);

// The corners of a marker of the given size in its own frame, metres: origin at the centre, x
// right, y up, z out of the print (Eq. 9 with the origin moved to the centre).
[[nodiscard]] inline std::array<Eigen::Vector3d, 4> markerCorners(double size_m) {
  const double h = 0.5 * size_m;
  return {Eigen::Vector3d(-h, h, 0.0), Eigen::Vector3d(h, h, 0.0), Eigen::Vector3d(h, -h, 0.0),
          Eigen::Vector3d(-h, -h, 0.0)};
}

}  // namespace waymark::slam
