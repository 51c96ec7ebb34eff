#include "slam/natural/filter/filter_state.h"

#include <algorithm>
#include <cassert>

#include "slam/natural/filter/se3.h"

namespace waymark::slam {
namespace {

constexpr int kRowsAtOnce = 16;  // of the update's tiles

Eigen::Matrix3d normalized(const Eigen::Matrix3d& R) {
  return Eigen::Quaterniond(R).normalized().toRotationMatrix();
}

Transform moved(const double* xi, const Transform& T) {
  const Transform motion = expSe3(Eigen::Map<const Vector6d>(xi));
  return {normalized(motion.R * T.R), motion * T.p};
}

}  // namespace

FilterState::FilterState(int max_poses, int max_features)
    : poses_(static_cast<std::size_t>(max_poses)),
      features_(static_cast<std::size_t>(max_features)),
      size_(kMotionSize),
      capacity_(kMotionSize + kPoseSize * max_poses + kFeatureSize * max_features),
      stride_((capacity_ + kRowsAtOnce - 1) / kRowsAtOnce * kRowsAtOnce),
      P_(static_cast<std::size_t>(stride_) * static_cast<std::size_t>(stride_), 0.0),
      dropped_(static_cast<std::size_t>(capacity_), 0) {
  kept_.reserve(static_cast<std::size_t>(capacity_));
  factor_.reserve(static_cast<std::size_t>(capacity_));
  slope_.reserve(static_cast<std::size_t>(capacity_));
  scale_direction_.reserve(static_cast<std::size_t>(capacity_));
  gauge_.reserve(static_cast<std::size_t>(capacity_));
  shared_.reserve(static_cast<std::size_t>(capacity_));
}

void FilterState::start(const Transform& T_w_c, const Matrix6d& covariance,
                        const Matrix6d& velocity_covariance) {
  T_w_c_ = T_w_c;
  v_w_.setZero();
  omega_c_.setZero();
  std::fill(poses_.begin(), poses_.end(), StatePose{});
  std::fill(features_.begin(), features_.end(), StateFeature{});
  std::fill(dropped_.begin(), dropped_.end(), char{0});
  drops_ = false;
  feature_count_ = 0;
  size_ = kMotionSize;
  std::fill(P_.begin(), P_.end(), 0.0);
  block(0, 0, 6, 6) = covariance;
  block(6, 6, 6, 6) = velocity_covariance;
}

FilterState::Motion FilterState::motion(double dt, const MotionNoiseOptions& noise) const {
  // R' = R Exp(omega dt), p' = p + v dt, v' = v. An error of omega turns the camera by
  // dtheta = R Jr dt domega; as a motion of the world that also carries p' and v' along, which
  // stay where they are: hence the cross products.
  const Eigen::Matrix3d turn = T_w_c_.R * expSo3(omega_c_ * dt) * rightJacobianSo3(omega_c_ * dt);
  const Eigen::Vector3d p = T_w_c_.p + dt * v_w_;
  const auto rotationPath = [&](const Eigen::Matrix3d& dtheta) {
    Eigen::Matrix<double, kMotionSize, 3> G = Eigen::Matrix<double, kMotionSize, 3>::Zero();
    G.middleRows<3>(kPositionAt) = skew(p) * dtheta;
    G.middleRows<3>(kRotationAt) = dtheta;
    G.middleRows<3>(kVelocityAt) = skew(v_w_) * dtheta;
    return G;
  };
  Motion m;
  m.F.setIdentity();
  m.F.block<3, 3>(kPositionAt, kVelocityAt) = dt * Eigen::Matrix3d::Identity();
  m.F.middleCols<3>(kOmegaAt) += rotationPath(dt * turn);

  // White accelerations: q [dt^3/3 dt^2/2; dt^2/2 dt] of what they are integrated into.
  const double q_v = noise.acceleration * noise.acceleration;
  const double q_w = noise.angular_acceleration * noise.angular_acceleration;
  m.Q.setZero();
  const auto eye = Eigen::Matrix3d::Identity();
  m.Q.block<3, 3>(kPositionAt, kPositionAt) = q_v * dt * dt * dt / 3.0 * eye;
  m.Q.block<3, 3>(kPositionAt, kVelocityAt) = q_v * dt * dt / 2.0 * eye;
  m.Q.block<3, 3>(kVelocityAt, kPositionAt) = q_v * dt * dt / 2.0 * eye;
  m.Q.block<3, 3>(kVelocityAt, kVelocityAt) = q_v * dt * eye;
  const Eigen::Matrix<double, kMotionSize, 3> path = rotationPath(turn);
  Eigen::Matrix<double, kMotionSize, 3> rate = Eigen::Matrix<double, kMotionSize, 3>::Zero();
  rate.middleRows<3>(kOmegaAt).setIdentity();
  m.Q += q_w * dt * dt * dt / 3.0 * (path * path.transpose());
  m.Q += q_w * dt * dt / 2.0 * (path * rate.transpose() + rate * path.transpose());
  m.Q += q_w * dt * (rate * rate.transpose());
  return m;
}

void FilterState::propagate(double dt_s, const MotionNoiseOptions& noise) {
  const Motion m = motion(dt_s, noise);
  // The motion's own block, then what it has in common with the rest.
  const Eigen::Matrix<double, kMotionSize, kMotionSize> own = block(0, 0, kMotionSize, kMotionSize);
  block(0, 0, kMotionSize, kMotionSize) = m.F * own * m.F.transpose() + m.Q;
  for (int c = kMotionSize; c < size_; ++c) {
    const Eigen::Matrix<double, kMotionSize, 1> with =
        m.F * Eigen::Matrix<double, kMotionSize, 1>(block(0, c, kMotionSize, 1));
    for (int r = 0; r < kMotionSize; ++r) {
      block(r, c, 1, 1)(0, 0) = with[r];
      block(c, r, 1, 1)(0, 0) = with[r];
    }
  }
  T_w_c_.p += dt_s * v_w_;
  T_w_c_.R = normalized(T_w_c_.R * expSo3(omega_c_ * dt_s));
}

int FilterState::append(int count) {
  assert(size_ + count <= capacity_);
  const int offset = size_;
  size_ += count;
  block(0, offset, size_, count).setZero();
  block(offset, 0, count, size_).setZero();
  return offset;
}

int FilterState::freePose() const {
  const auto free = std::find_if(poses_.begin(), poses_.end(),
                                 [](const StatePose& pose) { return pose.offset < 0; });
  return free == poses_.end() ? -1 : static_cast<int>(free - poses_.begin());
}

int FilterState::clonePose(PoseKind kind, std::uint64_t tag) {
  compact();
  const int place = freePose();
  if (place < 0) return -1;
  const int offset = append(kPoseSize);
  block(0, offset, offset, kPoseSize) = block(0, 0, offset, kPoseSize);
  block(offset, 0, kPoseSize, offset) = block(0, 0, kPoseSize, offset);
  block(offset, offset, kPoseSize, kPoseSize) = block(0, 0, kPoseSize, kPoseSize);
  poses_[static_cast<std::size_t>(place)] = {T_w_c_, kind, tag, offset, 0};
  return place;
}

int FilterState::addPose(PoseKind kind, std::uint64_t tag, const Transform& T_w_s,
                         const Matrix6d& covariance) {
  compact();
  const int place = freePose();
  if (place < 0) return -1;
  const int offset = append(kPoseSize);
  block(offset, offset, kPoseSize, kPoseSize) = covariance;
  poses_[static_cast<std::size_t>(place)] = {T_w_s, kind, tag, offset, 0};
  return place;
}

int FilterState::addPoseInView(PoseKind kind, std::uint64_t tag, const Transform& T_c_s,
                               const Matrix6d& covariance) {
  const int place = clonePose(kind, tag);  // the same motion of the world moves both
  if (place < 0) return -1;
  StatePose& pose = poses_[static_cast<std::size_t>(place)];
  pose.T_w_s = T_w_c_ * T_c_s;
  block(pose.offset, pose.offset, kPoseSize, kPoseSize) += covariance;
  return place;
}

int FilterState::addFeature(int pose, const Eigen::Vector2d& uv, double rho,
                            const Eigen::Matrix3d& covariance, const double* from_state) {
  compact();
  const auto free = std::find_if(features_.begin(), features_.end(),
                                 [](const StateFeature& f) { return f.offset < 0; });
  if (free == features_.end()) return -1;
  const int offset = append(kFeatureSize);
  block(offset, offset, kFeatureSize, kFeatureSize) = covariance;
  if (from_state != nullptr) {
    const int at = offset + 2;
    double variance = covariance(2, 2);
    for (int i = 0; i < offset; ++i) {
      if (from_state[i] != 0.0) block(0, at, offset, 1) += from_state[i] * block(0, i, offset, 1);
    }
    for (int i = 0; i < offset; ++i) variance += from_state[i] * P(i, at);
    block(at, 0, 1, offset) = block(0, at, offset, 1).transpose();
    block(at, at, 1, 1)(0, 0) = variance;
  }
  *free = {uv, rho, pose, offset};
  ++poses_[static_cast<std::size_t>(pose)].features;
  ++feature_count_;
  return static_cast<int>(free - features_.begin());
}

void FilterState::removeFeature(int feature) {
  StateFeature& f = features_[static_cast<std::size_t>(feature)];
  std::fill_n(dropped_.begin() + f.offset, kFeatureSize, char{1});
  drops_ = true;
  --poses_[static_cast<std::size_t>(f.pose)].features;
  --feature_count_;
  f = {};
}

void FilterState::removePose(int pose) {
  StatePose& p = poses_[static_cast<std::size_t>(pose)];
  assert(p.features == 0);
  std::fill_n(dropped_.begin() + p.offset, kPoseSize, char{1});
  drops_ = true;
  p = {};
}

void FilterState::compact() {
  if (!drops_) return;
  kept_.clear();
  for (int i = 0; i < size_; ++i) {
    if (!dropped_[static_cast<std::size_t>(i)]) kept_.push_back(i);
  }
  // Forwards: what is read has not been written yet.
  const int left = static_cast<int>(kept_.size());
  for (int c = 0; c < left; ++c) {
    const double* const from =
        P_.data() + static_cast<std::ptrdiff_t>(kept_[static_cast<std::size_t>(c)]) * stride_;
    double* const to = P_.data() + static_cast<std::ptrdiff_t>(c) * stride_;
    for (int r = 0; r < left; ++r) to[r] = from[kept_[static_cast<std::size_t>(r)]];
  }
  const auto newOffset = [&](int offset) {
    return static_cast<int>(std::lower_bound(kept_.begin(), kept_.end(), offset) - kept_.begin());
  };
  for (StatePose& pose : poses_) {
    if (pose.offset >= 0) pose.offset = newOffset(pose.offset);
  }
  for (StateFeature& feature : features_) {
    if (feature.offset >= 0) feature.offset = newOffset(feature.offset);
  }
  size_ = left;
  std::fill(dropped_.begin(), dropped_.end(), char{0});
  drops_ = false;
}

void FilterState::move(const double* delta) {
  // v = Exp(theta) v + J(theta) xi_v, as a position would be.
  const Eigen::Map<const Eigen::Vector3d> theta(delta + kRotationAt);
  const Eigen::Map<const Eigen::Vector3d> xi_v(delta + kVelocityAt);
  v_w_ = expSo3(theta) * v_w_ + leftJacobianSo3(theta) * xi_v;
  omega_c_ += Eigen::Map<const Eigen::Vector3d>(delta + kOmegaAt);
  T_w_c_ = moved(delta, T_w_c_);
  for (StatePose& pose : poses_) {
    if (pose.offset >= 0) pose.T_w_s = moved(delta + pose.offset, pose.T_w_s);
  }
  for (StateFeature& feature : features_) {
    if (feature.offset < 0) continue;
    feature.uv += Eigen::Map<const Eigen::Vector2d>(delta + feature.offset);
    feature.rho += delta[feature.offset + 2];
  }
}

void FilterState::moveWorld(const Transform& T) {
  compact();
  const Matrix6d A = adjoint(T);
  const auto transform = [&](int offset, const auto& J) {
    constexpr int kRows = std::decay_t<decltype(J)>::RowsAtCompileTime;
    for (int c = 0; c < size_; ++c) {
      const Eigen::Matrix<double, kRows, 1> x = block(offset, c, kRows, 1);
      block(offset, c, kRows, 1) = J * x;
    }
    for (int r = 0; r < size_; ++r) {
      const Eigen::Matrix<double, 1, kRows> x = block(r, offset, 1, kRows);
      block(r, offset, 1, kRows) = x * J.transpose();
    }
  };
  transform(0, A);
  transform(kVelocityAt, T.R);
  T_w_c_ = {normalized(T.R * T_w_c_.R), T * T_w_c_.p};
  v_w_ = T.R * v_w_;
  for (StatePose& pose : poses_) {
    if (pose.offset < 0) continue;
    transform(pose.offset, A);
    pose.T_w_s = {normalized(T.R * pose.T_w_s.R), T * pose.T_w_s.p};
  }
}

void FilterState::tieWorldTo(int pose, const Transform& T_w_s, const Matrix6d& covariance) {
  const StatePose& tied = poses_[static_cast<std::size_t>(pose)];
  moveWorld(T_w_s * tied.T_w_s.inverse());
  // xi_i becomes xi_i - xi_tied, for all poses at once, then plus what is known of the tied one.
  const int offset = tied.offset;
  const auto eachPose = [&](const auto& use) {
    use(0);
    for (const StatePose& other : poses_) {
      if (other.offset >= 0 && other.offset != offset) use(other.offset);
    }
  };
  const auto subtractRows = [&](int at) {
    block(at, 0, kPoseSize, size_) -= block(offset, 0, kPoseSize, size_);
  };
  const auto subtractColumns = [&](int at) {
    block(0, at, size_, kPoseSize) -= block(0, offset, size_, kPoseSize);
  };
  eachPose(subtractRows);
  eachPose(subtractColumns);
  block(offset, 0, kPoseSize, size_).setZero();
  block(0, offset, size_, kPoseSize).setZero();
  eachPose([&](int row) {
    eachPose([&](int column) { block(row, column, kPoseSize, kPoseSize) += covariance; });
    block(row, offset, kPoseSize, kPoseSize) = covariance;
    block(offset, row, kPoseSize, kPoseSize) = covariance;
  });
  block(offset, offset, kPoseSize, kPoseSize) = covariance;
}

std::optional<int> FilterState::findPose(PoseKind kind, std::uint64_t tag) const {
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    if (poses_[i].offset >= 0 && poses_[i].kind == kind && poses_[i].tag == tag) {
      return static_cast<int>(i);
    }
  }
  return std::nullopt;
}

Matrix6d FilterState::poseCovariance() const {
  const Matrix6d A = retractFromInvariant(T_w_c_.p);
  const Matrix6d own = P<6, 6>(0, 0);
  return A * own * A.transpose();
}

}  // namespace waymark::slam
