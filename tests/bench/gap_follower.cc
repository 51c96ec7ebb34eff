#include "tests/bench/gap_follower.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include <Eigen/Cholesky>

namespace waymark::bench {
namespace {

using Eigen::Vector3d;
using slam::PoseEstimate;
using slam::Transform;

constexpr double kShortestGap_s = 1.0;
constexpr double kShortestWay_m = 0.3;  // that has a scale

struct Moment {
  double time_s = 0.0;
  double error_m = 0.0;
  bool by_markers = false;
};

// A stretch of poses that are beyond lasts until the next frame that is not.
void note(const Moment& now, bool is_beyond, bool* lasts, std::vector<Beyond>* stretches) {
  if (*lasts) stretches->back().end_s = now.time_s;
  if (is_beyond) {
    if (!*lasts) {
      stretches->push_back({.begin_s = now.time_s, .end_s = now.time_s, .by_markers = true});
    }
    Beyond& beyond = stretches->back();
    beyond.worst_m = std::max(beyond.worst_m, now.error_m);
    beyond.by_markers = beyond.by_markers && now.by_markers;
  }
  *lasts = is_beyond;
}

// What is told of a position along a direction of length 1.
double varianceAlong(const PoseEstimate& pose, const Vector3d& direction) {
  return direction.dot(pose.covariance.topLeftCorner<3, 3>() * direction);
}

// What is told of the end's place along the way is of its length and of where it began, which have
// more or less in common: the scale's share is that at most.
std::optional<Scale> scaleOf(const PoseEstimate& start, const Transform& true_start,
                             const PoseEstimate& end, const Transform& true_end) {
  const Vector3d way = true_end.p - true_start.p;
  const double length_m = way.norm();
  if (!(length_m > kShortestWay_m)) return std::nullopt;
  const Vector3d along = way / length_m;
  return Scale{along.dot(end.T_w_c.p - start.T_w_c.p) / length_m - 1.0,
               std::sqrt(varianceAlong(end, along)) / length_m};
}

}  // namespace

std::int64_t firstWay(const simulator::Simulation& simulation) {
  constexpr double kSamePlace_m = 0.5;
  const std::int64_t frames = simulation.frameCount();
  const Vector3d apart = simulation.poseAt(frames - 1).p - simulation.poseAt(0).p;
  return apart.norm() < kSamePlace_m ? frames / 2 : frames;
}

std::optional<Carried> GapFollower::compare(const PoseEstimate& pose, const Transform& truth,
                                            const Transform& truth_by_marker) const {
  const Eigen::LLT<slam::Matrix6d> factor(pose.covariance);
  if (factor.info() != Eigen::Success) return std::nullopt;
  const slam::Vector6d e = pose.T_w_c.localCoordinates(truth);
  const double error_m = e.head<3>().norm();
  const Vector3d along = error_m > 0.0 ? Vector3d(e.head<3>() / error_m) : Vector3d::UnitX();
  Carried now;
  now.error_m = error_m;
  now.from_marker_m = (pose.T_w_c.p - truth_by_marker.p).norm();
  now.turn_from_marker_deg =
      slam::rotationDistance(pose.T_w_c.R, truth_by_marker.R) * 180.0 / std::numbers::pi;
  now.sigma_m = std::sqrt(pose.covariance.topLeftCorner<3, 3>().trace());
  now.sigma_along_m = std::sqrt(varianceAlong(pose, along));
  now.nees = e.dot(factor.solve(e));
  if (start_) now.scale = scaleOf(start_->pose, start_->truth, pose, truth);
  return now;
}

void GapFollower::add(double time_s, const slam::FrameResult& result, const Transform& T_scene_c,
                      const Transform& T_w_scene, const Transform& T_w_scene_by_marker) {
  ++report_->frames;
  if (result.pose) ++report_->posed;
  const bool by_markers = result.pose && result.pose->source == slam::PoseSource::kMarkers;
  const Transform truth = T_w_scene * T_scene_c;
  const auto now =
      result.pose ? compare(*result.pose, truth, T_w_scene_by_marker * T_scene_c) : std::nullopt;
  const Moment moment{time_s, now ? now->error_m : 0.0, by_markers};
  const bool is_beyond = now && now->nees > 9.0 * 6.0;
  if (is_beyond) ++report_->beyond_3_sigma;
  note(moment, is_beyond, &is_beyond_, &report_->beyond);
  // Not against the root of the trace: a large doubt in height excuses no error along the wall.
  note(moment, now && now->error_m > 3.0 * now->sigma_along_m, &is_position_beyond_,
       &report_->beyond_position);
  if (by_markers) {
    close(result.pose->T_w_c, truth);
    gap_ = Gap{.begin_s = time_s, .end_s = time_s};
    start_ = Start{*result.pose, truth};
    before_ = {result.pose->T_w_c, truth};
  } else if (gap_) {
    extend(time_s, result, truth, now);
  }
}

void GapFollower::extend(double time_s, const slam::FrameResult& result, const Transform& truth,
                         const std::optional<Carried>& now) {
  gap_->way_m += (truth.p - before_.truth.p).norm();
  gap_->end_s = time_s;
  ++gap_->frames;
  gap_->last = now;
  before_.truth = truth;
  if (!result.pose) return;
  ++gap_->posed;
  before_.estimate = result.pose->T_w_c;
  for (std::size_t i = 0; i < kInto_s.size(); ++i) {
    if (!gap_->into[i] && time_s - gap_->begin_s >= kInto_s[i]) gap_->into[i] = now;
  }
}

void GapFollower::close(const Transform& estimate, const Transform& truth) {
  if (!gap_ || gap_->end_s - gap_->begin_s < kShortestGap_s) return;
  if (gap_->last) {
    // What the camera itself did meanwhile is no jump.
    const Vector3d moved = truth.p - before_.truth.p;
    gap_->jump_m = (estimate.p - before_.estimate.p - moved).norm();
  }
  report_->gaps.push_back(*gap_);
}

}  // namespace waymark::bench
