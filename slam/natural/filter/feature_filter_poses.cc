// Of FeatureFilter: cameras of earlier frames, and what others say of them.
#include <algorithm>
#include <cstddef>

#include <Eigen/Cholesky>

#include "slam/geometry/turned_covariance.h"
#include "slam/natural/filter/feature_filter.h"
#include "slam/natural/filter/se3.h"

namespace waymark::slam {

FeatureFilter::PoseInnovation FeatureFilter::innovationAt(int offset, const Transform& T_w_s,
                                                          const Transform& measured,
                                                          const Matrix6d& covariance) const {
  // measured = Exp(noise) Exp(xi) T_w_s: the residual is a motion of the world itself, H is one.
  PoseInnovation innovation;
  innovation.residual = logSe3(measured * T_w_s.inverse());
  const Matrix6d A = invariantFromRetract(measured.p);
  innovation.noise = A * covariance * A.transpose();
  const Matrix6d S = state_.P<6, 6>(offset, offset) + innovation.noise;
  innovation.chi2 = innovation.residual.dot(S.ldlt().solve(innovation.residual));
  return innovation;
}

PoseOutcome FeatureFilter::observePoseAt(int offset, const Transform& T_w_s,
                                         const Transform& measured, const Matrix6d& covariance) {
  const PoseInnovation innovation = innovationAt(offset, T_w_s, measured, covariance);
  if (!(innovation.chi2 <= options_.pose_chi2)) return PoseOutcome::kRefused;
  const int n = state_.size();
  update_.begin(n, kPoseSize);
  for (int k = 0; k < kPoseSize; ++k) {
    const double* const column =
        state_.covariance() + static_cast<std::ptrdiff_t>(offset + k) * state_.stride();
    std::copy_n(column, n, update_.stateCovariance(k));
    for (int j = 0; j <= k; ++j) {
      update_.innovationCovariance(k, j) = column[offset + j] + innovation.noise(k, j);
    }
    update_.residual(k) = innovation.residual[k];
  }
  if (!update_.solve()) return PoseOutcome::kRefused;
  state_.correct(update_.delta());
  update_.reduce(state_.covariance(), state_.stride());
  state_.followScale();
  return PoseOutcome::kUsed;
}

PoseOutcome FeatureFilter::observePose(const Transform& T_w_c, const Matrix6d& covariance) {
  state_.compact();
  return observePoseAt(0, state_.camera(), T_w_c, covariance);
}

int FeatureFilter::addAnchor(const Transform& T_w_a, const Matrix6d& covariance) {
  const Matrix6d A = invariantFromRetract(T_w_a.p);
  return state_.addPose(PoseKind::kAnchor, ++last_anchor_, T_w_a, A * covariance * A.transpose());
}

Matrix6d FeatureFilter::anchorCovariance(int anchor) const {
  const StatePose& pose = state_.poses()[static_cast<std::size_t>(anchor)];
  const Matrix6d A = retractFromInvariant(pose.T_w_s.p);
  return A * state_.P<6, 6>(pose.offset, pose.offset) * A.transpose();
}

void FeatureFilter::markPast(std::uint64_t frame) {
  if (options_.max_past == 0) return;
  if (past_order_.size() >= static_cast<std::size_t>(options_.max_past)) {
    const auto place = state_.findPose(PoseKind::kPast, past_order_.front());
    if (place) state_.removePose(*place);
    past_order_.erase(past_order_.begin());
  }
  if (state_.clonePose(PoseKind::kPast, frame) >= 0) past_order_.push_back(frame);
}

void FeatureFilter::forgetPast() {
  for (const std::uint64_t frame : past_order_) {
    if (const auto place = state_.findPose(PoseKind::kPast, frame)) state_.removePose(*place);
  }
  past_order_.clear();
}

std::optional<Transform> FeatureFilter::pastPose(std::uint64_t frame) const {
  const auto place = state_.findPose(PoseKind::kPast, frame);
  if (!place) return std::nullopt;
  return state_.poses()[static_cast<std::size_t>(*place)].T_w_s;
}

std::optional<FeatureFilter::Motion> FeatureFilter::motionSince(std::uint64_t frame) const {
  const auto place = state_.findPose(PoseKind::kPast, frame);
  if (!place) return std::nullopt;
  const StatePose& past = state_.poses()[static_cast<std::size_t>(*place)];
  // One motion of the world less the other, as an error of the camera alone.
  const Matrix6d both = state_.P<6, 6>(0, past.offset);
  const Matrix6d between =
      state_.P<6, 6>(0, 0) + state_.P<6, 6>(past.offset, past.offset) - both - both.transpose();
  const Matrix6d A = retractFromInvariant(state_.camera().p);
  return Motion{past.T_w_s.inverse() * state_.camera(),
                turnedCovariance(past.T_w_s.R.transpose(), A * between * A.transpose())};
}

PoseOutcome FeatureFilter::comparePastPose(std::uint64_t frame, const Transform& T_w_c,
                                           const Matrix6d& covariance) const {
  const auto place = state_.findPose(PoseKind::kPast, frame);
  if (!place) return PoseOutcome::kUnknownFrame;
  const StatePose& past = state_.poses()[static_cast<std::size_t>(*place)];
  const double chi2 = innovationAt(past.offset, past.T_w_s, T_w_c, covariance).chi2;
  return chi2 <= options_.pose_chi2 ? PoseOutcome::kUsed : PoseOutcome::kRefused;
}

PoseOutcome FeatureFilter::observePastPose(std::uint64_t frame, const Transform& T_w_c,
                                           const Matrix6d& covariance) {
  const auto place = state_.findPose(PoseKind::kPast, frame);
  if (!place) return PoseOutcome::kUnknownFrame;
  state_.compact();
  const StatePose& past = state_.poses()[static_cast<std::size_t>(*place)];
  const PoseOutcome outcome = observePoseAt(past.offset, past.T_w_s, T_w_c, covariance);
  if (outcome == PoseOutcome::kUsed) {
    state_.removePose(*place);
    std::erase(past_order_, frame);
  }
  return outcome;
}

bool FeatureFilter::rescaleFromPast(std::uint64_t frame, double scale, double sigma) {
  const auto place = state_.findPose(PoseKind::kPast, frame);
  if (!place) return false;
  state_.compact();
  state_.scaleAbout(*place, scale, sigma);
  return true;
}

bool FeatureFilter::restartFromPast(std::uint64_t frame, const Transform& T_w_c,
                                    const Matrix6d& covariance) {
  const auto place = state_.findPose(PoseKind::kPast, frame);
  if (!place) return false;
  // What the markers had told of the world is what has turned out to be wrong.
  for (const MarkerSeen& seen : markers_seen_) {
    const auto marker = state_.findPose(PoseKind::kMarker, seen.id);
    if (marker) state_.removePose(*marker);
  }
  markers_seen_.clear();
  state_.compact();
  const Matrix6d A = invariantFromRetract(T_w_c.p);
  state_.tieWorldTo(*place, T_w_c, A * covariance * A.transpose());
  state_.removePose(*place);
  std::erase(past_order_, frame);
  return true;
}

}  // namespace waymark::slam
