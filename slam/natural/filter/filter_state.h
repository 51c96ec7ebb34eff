// What the filter knows: the camera and its motion, poses that features and measurements hang on,
// features, and the covariance of all of it.
//
// Parameterisation. Davison's state (camera position, orientation, velocity in the world, angular
// velocity in the camera; seed 2, section 3.2) with features by inverse depth in the camera that
// first saw them, whose pose (the anchor) stays in the state. Fiducial markers' poses and the
// cameras of frames that are still being looked at elsewhere are poses of the same kind. All poses'
// errors are motions of the world, T = Exp(xi) T_estimated (se3.h), and so are the velocity's.
//
// Why. In a gap neither the place nor the orientation of the whole is observable. Every measurement
// here is one of a pose relative to another, so its Jacobian by the one is minus that by the other,
// and the same xi for all is a null direction of every measurement and of the motion exactly,
// wherever they are linearised: nothing can be gained along it. The usual coordinates need
// first-estimate Jacobians for that, at the price of wrong ones; a robocentric state needs a
// composition that mixes all features in every frame; a window of past poses forgets points that
// are still in view. Measured: mean NEES of the pose over 50 runs of 3.5 m, 5.3 to 5.6 of 6 all the
// way (feature_filter_test).
//
// Scale is not observable either, where no marker is in view, and its direction does change: a
// place grows with it and an inverse depth shrinks, so that a correction by 2 % turns it by 4 %
// against what the covariance says, and by what the camera has moved otherwise than it was expected
// to. To the next images that difference is parallax: of a scale known to 15 % nothing was left but
// 2 % within two frames. So the covariance follows the direction (Huang, Mourikis and Roumeliotis
// 2010 choose Jacobians for the same end): followScale().
//
// A feature's bearing is a state, too: the patch in the anchor's image has noise of its own, which
// all later measurements share. Taken as exact it is averaged away, which it is not: NEES 36.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/transform.h"
#include "slam/natural/filter/motion_noise.h"

namespace waymark::slam {

inline constexpr int kMotionSize = 12;  // xi_p, theta, xi_v (world), omega (camera)
inline constexpr int kPositionAt = 0;   // in these
inline constexpr int kRotationAt = 3;
inline constexpr int kVelocityAt = 6;
inline constexpr int kOmegaAt = 9;
inline constexpr int kPoseSize = 6;     // xi
inline constexpr int kFeatureSize = 3;  // u, v, rho

enum class PoseKind : std::uint8_t {
  kAnchor,  // a camera that first saw features
  kMarker,  // a fiducial marker
  kPast,    // the camera of a frame that somebody may yet say something about
};

struct StatePose {
  Transform T_w_s;
  PoseKind kind = PoseKind::kAnchor;
  std::uint64_t tag = 0;  // kMarker: its id; kPast: the frame's number; kAnchor: its own
  int offset = -1;        // of its xi in the covariance; -1: this place is free
  int features = 0;       // that hang on it
};

// The point (u, v, 1) / rho in the anchor's frame.
struct StateFeature {
  Eigen::Vector2d uv = Eigen::Vector2d::Zero();  // normalized coordinates
  double rho = 0.0;                              // 1 / metres along the anchor's optical axis
  int pose = -1;                                 // the anchor's place
  int offset = -1;                               // in the covariance; -1: this place is free
};

// Of a new feature's (u, v, rho).
[[nodiscard]] inline Eigen::Matrix3d featureCovariance(const Eigen::Matrix2d& of_uv,
                                                       double rho_sigma) {
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  covariance.topLeftCorner<2, 2>() = of_uv;
  covariance(2, 2) = rho_sigma * rho_sigma;
  return covariance;
}

class FilterState {
 public:
  using Block = Eigen::Map<Eigen::MatrixXd, 0, Eigen::OuterStride<>>;
  using ConstBlock = Eigen::Map<const Eigen::MatrixXd, 0, Eigen::OuterStride<>>;

  // Takes all memory it will ever need.
  FilterState(int max_poses, int max_features);

  // Nothing but a camera, with a velocity of zero. covariance: of xi, then of xi_v and omega.
  void start(const Transform& T_w_c, const Matrix6d& covariance,
             const Matrix6d& velocity_covariance);

  // Constant velocity and angular velocity (seed 2, section 3.2), with white accelerations.
  void propagate(double dt_s, const MotionNoiseOptions& noise);

  // A copy of the camera as it is. -1 when there is no place.
  int clonePose(PoseKind kind, std::uint64_t tag);
  // A pose of its own, which nothing else knows of. covariance: of its xi.
  int addPose(PoseKind kind, std::uint64_t tag, const Transform& T_w_s, const Matrix6d& covariance);
  // One that the camera sees at T_c_s: what is not known of the camera is not known of it either,
  // beside what the covariance adds, of its xi.
  int addPoseInView(PoseKind kind, std::uint64_t tag, const Transform& T_c_s,
                    const Matrix6d& covariance);
  // covariance: of (u, v, rho). from_state: where rho is a function of the state, its derivative by
  // all coordinates, size() of them; the covariance is of what comes to that. -1 when there is no
  // place.
  int addFeature(int pose, const Eigen::Vector2d& uv, double rho, const Eigen::Matrix3d& covariance,
                 const double* from_state = nullptr);
  // Forgets them: what they had told stays.
  void removeFeature(int feature);
  void removePose(int pose);  // Precondition: no feature hangs on it.
  // Removals change the covariance only here, all of them at once.
  void compact();

  // Moves everything by a correction of all coordinates (size() of them). Its part along the
  // scale's direction makes everything larger or smaller about the camera, which no image shows.
  void correct(const double* delta);
  // After correct(), as soon as the covariance belongs to the state that was corrected: it follows
  // the scale's direction, see above. error: one of the state (size() numbers), which follows, too;
  // or null.
  void followScale(double* error = nullptr);
  // The world has moved: new = T_new_old * old, exactly.
  void moveWorld(const Transform& T_new_old);

  // Everything is so many times as large as it was, seen from a pose. sigma: of its logarithm, in
  // place of what was known of the scale.
  void scaleAbout(int pose, double scale, double sigma);

  // What is known of this pose replaces what was known of it and of the world: every pose keeps its
  // place relative to it. covariance: of its xi.
  void tieWorldTo(int pose, const Transform& T_w_s, const Matrix6d& covariance);

  [[nodiscard]] const Transform& camera() const { return T_w_c_; }
  [[nodiscard]] const Eigen::Vector3d& velocity() const { return v_w_; }  // m/s, world
  [[nodiscard]] const Eigen::Vector3d& angularVelocity() const {
    return omega_c_;
  }  // rad/s, camera
  [[nodiscard]] const std::vector<StatePose>& poses() const { return poses_; }
  [[nodiscard]] const std::vector<StateFeature>& features() const { return features_; }
  [[nodiscard]] int featureCount() const { return feature_count_; }
  [[nodiscard]] std::optional<int> findPose(PoseKind kind, std::uint64_t tag) const;

  // Coordinates in use; the covariance is symmetric, its columns stride() apart, a multiple of 16,
  // with finite numbers beyond size().
  [[nodiscard]] int size() const { return size_; }
  [[nodiscard]] int stride() const { return stride_; }
  [[nodiscard]] int capacity() const { return capacity_; }
  [[nodiscard]] double* covariance() { return P_.data(); }
  [[nodiscard]] const double* covariance() const { return P_.data(); }
  [[nodiscard]] ConstBlock P() const {
    return {P_.data(), size_, size_, Eigen::OuterStride<>(stride_)};
  }
  [[nodiscard]] double P(int row, int column) const {
    return P_[static_cast<std::size_t>(column) * static_cast<std::size_t>(stride_) +
              static_cast<std::size_t>(row)];
  }
  template <int Rows, int Columns>
  [[nodiscard]] Eigen::Matrix<double, Rows, Columns> P(int row, int column) const {
    Eigen::Matrix<double, Rows, Columns> block;
    for (int c = 0; c < Columns; ++c) {
      for (int r = 0; r < Rows; ++r) block(r, c) = P(row + r, column + c);
    }
    return block;
  }

  // How well the scale is known: of the mean of the depths' logarithms, weighed by how well each is
  // known, a standard deviation, a share. 0 without features. Not between correct() and
  // followScale(), which has its gauge from there.
  [[nodiscard]] double scaleSigma();
  // Of the camera: (dp, dtheta) as Transform::retract, metres and radians in the world frame.
  [[nodiscard]] Matrix6d poseCovariance() const;

  // d(state after) / d(state before) of the motion's errors, and what the noise adds to them.
  struct Motion {
    Eigen::Matrix<double, kMotionSize, kMotionSize> F;
    Eigen::Matrix<double, kMotionSize, kMotionSize> Q;
  };
  [[nodiscard]] Motion motion(double dt_s, const MotionNoiseOptions& noise) const;

 private:
  [[nodiscard]] Block block(int row, int column, int rows, int columns) {
    return {P_.data() + static_cast<std::ptrdiff_t>(column) * stride_ + row, rows, columns,
            Eigen::OuterStride<>(stride_)};
  }
  // What tells the scale's part of an error: gauge_. The variance of that part if each depth were
  // in error by itself.
  double findGauge();
  // What that has in common with all coordinates, shared_; its variance.
  double findShared();
  // Both, zeros where no scale is in doubt but single depths; the scale's variance.
  double findCommonScale();
  // How all coordinates move as everything gets larger about the camera, by the scale's logarithm.
  void findScaleDirection();
  void move(const double* delta);
  void enlarge(double factor);
  // Appends coordinates that nothing is known to have in common with.
  int append(int count);
  int freePose() const;

  Transform T_w_c_;
  Eigen::Vector3d v_w_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d omega_c_ = Eigen::Vector3d::Zero();
  std::vector<StatePose> poses_;
  std::vector<StateFeature> features_;
  int feature_count_ = 0;
  int size_ = 0;
  int capacity_ = 0;
  int stride_ = 0;
  std::vector<double> P_;
  std::vector<int> kept_;               // while compacting
  std::vector<double> factor_, slope_;  // while scaling
  // Of the last correction: the scale's direction, and what tells its part of an error; what that
  // has in common with all coordinates.
  std::vector<double> scale_direction_, gauge_, shared_;
  std::vector<char> dropped_;  // coordinates that are to go
  bool drops_ = false;
};

}  // namespace waymark::slam
