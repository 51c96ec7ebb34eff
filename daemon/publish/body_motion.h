// Where the robot's body is and how it moves, from the camera's poses.
#pragma once

#include <cstdint>
#include <optional>

#include <Eigen/Core>

#include "slam/frame.h"
#include "slam/geometry/transform.h"
#include "slam/pose_estimate.h"

namespace waymark::daemon {

struct BodyState {
  slam::Transform T_w_b;
  Eigen::Vector3d velocity_b = Eigen::Vector3d::Zero();  // metres per second, in the body frame
  Eigen::Vector3d rotation_rate_b = Eigen::Vector3d::Zero();  // radians per second, likewise
};

// A Kalman filter over pose and velocity: between two frames the body goes on as it did, up to
// white accelerations, and each pose counts as much as its covariance relative to the markers in
// view says: the rest of its covariance in the world is an offset that neighbouring frames share.
// The poses themselves are handed on as they came; only the velocities are the filter's.
class BodyMotion {
 public:
  struct Options {
    slam::Transform T_b_c;  // where the camera sits on the body
    // Spectral densities of the accelerations: 2 m/s^2 and 3 rad/s^2 that last for 0.1 s. Larger
    // follows faster and is noisier.
    double acceleration = 0.4;          // m^2/s^3
    double angular_acceleration = 1.0;  // rad^2/s^3
    // A velocity across a longer gap says nothing; it starts anew from zero.
    double max_gap_s = 0.5;
    // A pose further off than chance allows (chi-square of 6, one in 10^9) is a jump of the map, as
    // when a loop closes, and no motion. Two in a row are a motion that nobody expected.
    double jump_chi2 = 50.0;
  };

  explicit BodyMotion(const Options& options) : options_(options) {}

  // The state with this frame's pose. Velocities are zero in the first frame.
  // In another piece of the map, of whose world nothing was told, too.
  [[nodiscard]] BodyState update(const slam::PoseEstimate& pose, std::int64_t monotonic_ns);
  // Poses come in the world of `piece` from now on. Where the event says how that lies to the world
  // before, the velocity stays what it was, seen from there.
  void enterWorld(int piece, const slam::PieceEvent& event);

 private:
  using Vector12d = Eigen::Matrix<double, 12, 1>;
  using Matrix12d = Eigen::Matrix<double, 12, 12>;

  void begin(const slam::Transform& T_w_b, const slam::Matrix6d& covariance);
  void predict(double dt_s);
  // False, and nothing done, when the pose is a jump.
  [[nodiscard]] bool correct(const slam::Transform& T_w_b, const slam::Matrix6d& covariance);

  const Options options_;
  std::optional<std::int64_t> last_ns_;
  int piece_ = 0;
  bool jumped_ = false;                              // in the last frame
  slam::Transform T_w_b_;                            // the filter's
  slam::Vector6d twist_w_ = slam::Vector6d::Zero();  // velocity and rotation rate, world frame
  Matrix12d covariance_ = Matrix12d::Zero();         // of (dp, dtheta), world frame, and twist_w_
};

}  // namespace waymark::daemon
