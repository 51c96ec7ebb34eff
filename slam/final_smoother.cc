#include "slam/final_smoother.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "base/elapsed.h"
#include "slam/covariance/marginals.h"
#include "slam/geometry/moved_on.h"
#include "slam/geometry/turned_covariance.h"

namespace waymark::slam {
namespace {

// Frames further apart than this say nothing of each other's place, seconds.
constexpr double kLongest_s = 1.0;
// Of the frames without features those so near to one with some tell where it is, seconds.
constexpr double kNear_s = 3.0;
// How a hand or a robot accelerates, metres and radians per second squared.
constexpr double kAcceleration = 3.0;
constexpr double kTurning = 10.0;
// A marker's corners are off in common for so long, seconds: frames within it are one.
constexpr double kCommon_s = 0.2;
// What is known of a stretch before any marker has said anything, metres and radians.
constexpr double kUnknown_m = 10.0;
constexpr double kUnknown_rad = 1.0;

// How the camera moved from one frame to the next, and how well that is known: in the world, at the
// later one.
struct Motion {
  Transform T_before_now;
  Matrix6d covariance = Matrix6d::Zero();
};

// As large as the eigenvalues, whatever their sign.
Matrix6d absolute(const Matrix6d& symmetric) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(symmetric);
  return solver.eigenvectors() * solver.eigenvalues().cwiseAbs().asDiagonal() *
         solver.eigenvectors().transpose();
}

// A live pose is also corrected, by a marker or with the whole world. That is no motion: where the
// difference is further from the mean of both frames' velocities than the camera accelerates, these
// tell.
Motion motionBetween(const LiveFrame& before, const LiveFrame& now) {
  constexpr double kSigmas = 4.0;
  const double dt_s = secondsBetween(before.monotonic_ns, now.monotonic_ns);
  const Twist twist = twistBetween(now.pose->twist, before.pose->twist, 0.0);
  const Transform expected = movedOn(Transform{}, twist, dt_s);
  const Transform told = before.pose->T_w_c.inverse() * now.pose->T_w_c;
  const double sigma_m = 0.5 * kAcceleration * dt_s * dt_s;
  const double sigma_rad = 0.5 * kTurning * dt_s * dt_s;
  const Vector6d apart = expected.localCoordinates(told);
  const bool by_features = before.pose->features_used > 0 && now.pose->features_used > 0;
  const bool moved =
      apart.head<3>().norm() < kSigmas * sigma_m && apart.tail<3>().norm() < kSigmas * sigma_rad;
  if (!by_features || !moved) return {expected, independentCovariance(sigma_m, sigma_rad)};
  const Matrix6d F = rigidTransport(now.pose->T_w_c.p - before.pose->T_w_c.p);
  return {told,
          absolute(now.pose->view_covariance - F * before.pose->view_covariance * F.transpose())};
}

// A stretch of frames, one after the other.
class Stretch {
 public:
  using Placed = std::span<const std::optional<PoseEstimate>>;

  Stretch(std::span<const LiveFrame> frames, Placed placed) : frames_(frames), placed_(placed) {}

  void smooth(std::span<std::optional<SmoothedPose>> smoothed) {
    if (std::ranges::none_of(placed_, [](const auto& pose) { return pose.has_value(); })) return;
    chain();
    forwards();
    backwards(smoothed);
  }

 private:
  // What poses of the chain are off by: (dp, dtheta) of retract().
  struct State {
    Vector6d mean = Vector6d::Zero();
    Matrix6d covariance = Matrix6d::Zero();
  };
  struct Step {
    Transform T_w_c;           // by the motion alone
    Matrix6d F;                // errors of the frame before, at this one's place
    Matrix6d motion;           // covariance
    State expected, filtered;  // before and after the frame's markers
  };

  // The motion put together, in the map's coordinates at the first frame that it places.
  void chain() {
    steps_.resize(frames_.size());
    for (std::size_t i = 1; i < frames_.size(); ++i) {
      const Motion motion = motionBetween(frames_[i - 1], frames_[i]);
      steps_[i].T_w_c = steps_[i - 1].T_w_c * motion.T_before_now;
      // Told in the axes of the live world there.
      const Eigen::Matrix3d R = steps_[i].T_w_c.R * frames_[i].pose->T_w_c.R.transpose();
      steps_[i].motion = turnedCovariance(R, motion.covariance);
    }
    const auto first = std::ranges::find_if(placed_, [](const auto& p) { return p.has_value(); });
    const auto at = static_cast<std::size_t>(first - placed_.begin());
    const Transform T_map_chain = (*first)->T_w_c * steps_[at].T_w_c.inverse();
    for (Step& step : steps_) {
      step.T_w_c = T_map_chain * step.T_w_c;
      step.motion = turnedCovariance(T_map_chain.R, step.motion);
    }
    for (std::size_t i = 1; i < steps_.size(); ++i) {
      steps_[i].F = rigidTransport(steps_[i].T_w_c.p - steps_[i - 1].T_w_c.p);
    }
  }

  void forwards() {
    State state;
    state.covariance = independentCovariance(kUnknown_m, kUnknown_rad);
    for (std::size_t i = 0; i < steps_.size(); ++i) {
      Step& step = steps_[i];
      if (i > 0) {
        state.mean = step.F * state.mean;
        state.covariance = step.F * state.covariance * step.F.transpose() + step.motion;
      }
      step.expected = state;
      if (placed_[i]) state = corrected(state, step.T_w_c, *placed_[i], sharedBy(i));
      step.filtered = state;
    }
  }

  static State corrected(const State& state, const Transform& T_w_c, const PoseEstimate& pose,
                         double frames) {
    const Matrix6d S = state.covariance + frames * pose.view_covariance;
    const Matrix6d K = S.ldlt().solve(state.covariance).transpose();
    State result;
    result.mean = state.mean + K * (T_w_c.localCoordinates(pose.T_w_c) - state.mean);
    const Matrix6d rest = Matrix6d::Identity() - K;
    result.covariance = rest * state.covariance * rest.transpose() +
                        frames * K * pose.view_covariance * K.transpose();
    return result;
  }

  // Frames whose markers' errors are the same as those of the i-th: it and its neighbours.
  [[nodiscard]] double sharedBy(std::size_t i) const {
    const std::size_t other = i > 0 ? i - 1 : std::min(i + 1, frames_.size() - 1);
    const double interval_s =
        std::abs(secondsBetween(frames_[other].monotonic_ns, frames_[i].monotonic_ns));
    return interval_s > 0.0 ? std::max(1.0, kCommon_s / interval_s) : 1.0;
  }

  void backwards(std::span<std::optional<SmoothedPose>> smoothed) const {
    State later = steps_.back().filtered;
    for (std::size_t i = steps_.size(); i-- > 0;) {
      if (i + 1 < steps_.size()) later = before(later, steps_[i], steps_[i + 1]);
      smoothed[i] = {steps_[i].T_w_c.retract(later.mean), later.covariance};
    }
  }

  static State before(const State& later, const Step& step, const Step& next) {
    const State& now = step.filtered;
    const Matrix6d G = next.expected.covariance.ldlt().solve(next.F * now.covariance).transpose();
    State result;
    result.mean = now.mean + G * (later.mean - next.expected.mean);
    result.covariance =
        now.covariance + G * (later.covariance - next.expected.covariance) * G.transpose();
    return result;
  }

  std::span<const LiveFrame> frames_;
  Placed placed_;
  std::vector<Step> steps_;
};

// The frames with a pose that are near one whose pose is from features, in time.
std::vector<bool> nearFeatures(std::span<const LiveFrame> frames) {
  std::vector<bool> is_near(frames.size(), false);
  std::optional<std::int64_t> features_ns;
  const auto look = [&](std::size_t i) {
    const LiveFrame& frame = frames[i];
    if (frame.pose && frame.pose->features_used > 0) features_ns = frame.monotonic_ns;
    if (!frame.pose || !features_ns) return;
    const double away_s = std::abs(secondsBetween(*features_ns, frame.monotonic_ns));
    is_near[i] = is_near[i] || away_s <= kNear_s;
  };
  for (std::size_t i = 0; i < frames.size(); ++i) look(i);
  features_ns.reset();
  for (std::size_t i = frames.size(); i-- > 0;) look(i);
  return is_near;
}

}  // namespace

std::vector<std::optional<SmoothedPose>> smoothTrajectory(
    std::span<const LiveFrame> frames, std::span<const std::optional<PoseEstimate>> placed) {
  std::vector<std::optional<SmoothedPose>> smoothed(frames.size());
  const std::vector<bool> takes_part = nearFeatures(frames);
  std::size_t begin = 0;
  while (begin < frames.size()) {
    std::size_t end = begin;
    const auto goes_on = [&] {
      return end < frames.size() && takes_part[end] &&
             (end == begin ||
              secondsBetween(frames[end - 1].monotonic_ns, frames[end].monotonic_ns) <= kLongest_s);
    };
    while (goes_on()) ++end;
    const std::size_t count = end - begin;
    if (count > 0) {
      Stretch(frames.subspan(begin, count), placed.subspan(begin, count))
          .smooth(std::span(smoothed).subspan(begin, count));
    }
    begin = std::max(end, begin + 1);
  }
  return smoothed;
}

}  // namespace waymark::slam
