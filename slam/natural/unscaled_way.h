// What a filter's covariance leaves out of a way whose scale is hardly known.
//
// A way is the product of a scale and of what the images show of it. An extended Kalman filter's
// covariance is linear in both, which is enough for a scale known to 1 or 2 %, as it is in a gap
// that is crossed. A camera that turns on the spot, until nothing is left in view that was there
// before, has a scale known to some 10 %: a way that is hardly known is multiplied with depths that
// are not, and the error of what comes out is larger than it is told, most often to the short side.
#pragma once

#include <optional>
#include <string>

#include <Eigen/Core>

#include "slam/geometry/transform.h"

namespace waymark::slam {

struct UnscaledWayOptions {
  // From here on, a standard deviation of the scale as a share, a way is in doubt by more than the
  // covariance tells. Straight gaps stay below 0.016 of it, turns on the spot go beyond 0.07.
  double from_scale_sigma = 0.05;
  // By so many times what it tells. After forty turns in a corridor the logarithm of the scale was
  // 1.8 times its standard deviation (rms), five times at worst.
  double ratio = 2.5;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

class UnscaledWay {
 public:
  // The options must outlive it.
  explicit UnscaledWay(const UnscaledWayOptions& options) : options_(options) {}

  // The place is known from elsewhere.
  void forget();
  // Where the camera is in a frame, metres, world, and how well the scale is known there: a
  // standard deviation, as a share.
  void goOn(const Eigen::Vector3d& p_w, double scale_sigma);
  // Of the camera's position, metres squared: what is to be added to a covariance that is linear.
  [[nodiscard]] Eigen::Matrix3d covariance() const;
  // The world's coordinates have changed.
  void moveWorld(const Transform& T_new_old);

 private:
  const UnscaledWayOptions& options_;
  std::optional<Eigen::Vector3d> p_w_;  // of the frame before
  // Metres, world: a standard deviation of the scale's moves the camera by this.
  Eigen::Vector3d sigma_w_ = Eigen::Vector3d::Zero();
};

}  // namespace waymark::slam
