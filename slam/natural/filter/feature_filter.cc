#include "slam/natural/filter/feature_filter.h"

#include <algorithm>
#include <cmath>

#include "base/vectorized.h"
#include "slam/natural/filter/se3.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

constexpr int kMarkerNumbers = 8;        // of its four corners
constexpr double kMedianOfChi2 = 1.386;  // with two dimensions
// A linearisation is made anew where it is off by more than this, in units of the measurement's
// own sigma.
constexpr double kFarFromLinear = 0.5;
constexpr double kEachIsGated = 1e300;  // no limit for all of them together

// Columns of P for one measured point: of the camera, of the pose it hangs on, and of the feature
// (null for a point without).
struct Columns {
  const double* camera;
  const double* pose;
  const double* feature;
  std::ptrdiff_t stride;
};

// n numbers of P H^T for both measured numbers of a point, n a multiple of four.
WAYMARK_VECTORIZED void multiply(const Columns& P, const double* j_pose, const double* j_feature,
                                 int n, double* x, double* y) {
  for (int i = 0; i < n; ++i) {
    x[i] = 0.0;
    y[i] = 0.0;
  }
  for (int b = 0; b < kPoseSize; ++b) {
    const double* const pose = P.pose + b * P.stride;
    const double* const camera = P.camera + b * P.stride;
    const double jx = j_pose[2 * b];
    const double jy = j_pose[2 * b + 1];
    for (int i = 0; i < n; ++i) {
      const double d = pose[i] - camera[i];
      x[i] += jx * d;
      y[i] += jy * d;
    }
  }
  if (P.feature == nullptr) return;
  for (int b = 0; b < kFeatureSize; ++b) {
    const double* const feature = P.feature + b * P.stride;
    const double jx = j_feature[2 * b];
    const double jy = j_feature[2 * b + 1];
    for (int i = 0; i < n; ++i) {
      x[i] += jx * feature[i];
      y[i] += jy * feature[i];
    }
  }
}

int maxPoses(const FeatureFilterOptions& o) { return o.max_anchors + o.max_markers + o.max_past; }

int maxState(const FeatureFilterOptions& o) {
  return kMotionSize + kPoseSize * maxPoses(o) + kFeatureSize * o.max_features;
}

int maxNumbers(const FeatureFilterOptions& o) {
  return std::max(kMarkerNumbers, 2 * o.max_features);
}

}  // namespace

std::string FeatureFilterOptions::invalidReason() const {
  return firstReason(
      {firstUnmet({
           {max_features >= 4 && max_features <= 1000, "max_features must be 4 to 1000"},
           {max_anchors >= 1 && max_anchors <= 100, "max_anchors must be 1 to 100"},
           {max_markers >= 1 && max_markers <= 100, "max_markers must be 1 to 100"},
           {max_past >= 0 && max_past <= 100, "max_past must be 0 to 100"},
           {isPositive(match_chi2), "match_chi2 must be positive"},
           {isPositive(marker_chi2), "marker_chi2 must be positive"},
           {isPositive(pose_chi2), "pose_chi2 must be positive"},
           {hypotheses >= 1, "hypotheses must be at least 1"},
           {max_iterations >= 1, "max_iterations must be at least 1"},
           {isShare(marker_repeated_share), "marker_repeated_share must be from 0 to 1"},
           {isNotNegative(marker_memory_s), "marker_memory_s must not be negative"},
           {isShare(noise_adaption), "noise_adaption must be 0 to 1"},
           {max_noise_scale >= 1.0, "max_noise_scale must be at least 1"},
       }),
       motion.invalidReason()});
}

FeatureFilter::FeatureFilter(const FeatureFilterOptions& options)
    : options_(options),
      state_(maxPoses(options), options.max_features),
      update_(maxState(options), maxNumbers(options)),
      refuter_(options.max_features) {
  const auto features = static_cast<std::size_t>(std::max(options.max_features, 4));
  markers_seen_.reserve(static_cast<std::size_t>(options.max_markers));
  past_order_.reserve(static_cast<std::size_t>(options.max_past));
  measurements_.reserve(features);
  rows_.reserve(features);
  marked_.reserve(features);
  refutable_.reserve(features);
  kept_.reserve(2 * features);
  distances_.reserve(features);
  moved_.assign(static_cast<std::size_t>(maxState(options)), 0.0);
  step_.assign(static_cast<std::size_t>(maxState(options)), 0.0);
  row_.assign(static_cast<std::size_t>(maxState(options)), 0.0);
}

void FeatureFilter::start(const Transform& T_w_c, const Matrix6d& covariance) {
  const Matrix6d A = invariantFromRetract(T_w_c.p);
  Vector6d sigma;
  sigma.head<3>().setConstant(options_.motion.start_velocity_sigma);
  sigma.tail<3>().setConstant(options_.motion.start_angular_velocity_sigma);
  state_.start(T_w_c, A * covariance * A.transpose(), Matrix6d(sigma.cwiseAbs2().asDiagonal()));
  markers_seen_.clear();
  past_order_.clear();
  noise_scale_ = 1.0;
}

void FeatureFilter::predict(double dt_s) {
  time_s_ += dt_s;
  state_.propagate(dt_s, options_.motion);
}

// --- Updates -------------------------------------------------------------------------------------

bool FeatureFilter::linearize(const CameraModel* camera, const Measurement& m, Row* row) const {
  const StatePose& pose = state_.poses()[static_cast<std::size_t>(m.pose)];
  PointView view;
  if (m.feature >= 0) {
    const StateFeature& feature = state_.features()[static_cast<std::size_t>(m.feature)];
    if (!viewFeature(*camera, state_.camera(), pose.T_w_s, feature, &view)) return false;
    row->feature_at = feature.offset;
  } else {
    if (!viewPoint(state_.camera(), pose.T_w_s, m.p_s, &view)) return false;
    row->feature_at = -1;
  }
  row->pose_at = pose.offset;
  row->J_pose = view.J_pose;
  row->J_feature = view.J_feature;
  row->residual = m.seen - view.at;
  return true;
}

void FeatureFilter::linearizeAll(const CameraModel* camera) {
  rows_.clear();
  std::size_t seen = 0;
  for (const Measurement& m : measurements_) {
    Row row;
    if (!linearize(camera, m, &row)) continue;
    rows_.push_back(row);
    measurements_[seen++] = m;
  }
  measurements_.resize(seen);
  std::fill(moved_.begin(), moved_.end(), 0.0);
}

void FeatureFilter::assemble() {
  const int n = state_.size();
  const int count = static_cast<int>(rows_.size());
  const std::ptrdiff_t stride = state_.stride();
  const double* const P = state_.covariance();
  update_.begin(n, 2 * count);
  for (int i = 0; i < count; ++i) {
    const Row& row = rows_[static_cast<std::size_t>(i)];
    multiply({P, P + row.pose_at * stride,
              row.feature_at < 0 ? nullptr : P + row.feature_at * stride, stride},
             row.J_pose.data(), row.J_feature.data(), n, update_.stateCovariance(2 * i),
             update_.stateCovariance(2 * i + 1));
  }
  for (int i = 0; i < count; ++i) {
    const Row& row = rows_[static_cast<std::size_t>(i)];
    // H x of a vector over the state.
    const auto seen = [&row](const double* x) {
      const Eigen::Map<const Vector6d> camera(x);
      const Eigen::Map<const Vector6d> pose(x + row.pose_at);
      Eigen::Vector2d h = row.J_pose * (pose - camera);
      if (row.feature_at >= 0) {
        h += row.J_feature * Eigen::Map<const Eigen::Vector3d>(x + row.feature_at);
      }
      return h;
    };
    for (int k = 0; k < 2 * (i + 1); ++k) {
      const Eigen::Vector2d s = seen(update_.stateCovariance(k));
      update_.innovationCovariance(2 * i, k) = s.x();
      update_.innovationCovariance(2 * i + 1, k) = s.y();
    }
    const Eigen::Matrix2d& noise = measurements_[static_cast<std::size_t>(i)].noise;
    update_.innovationCovariance(2 * i, 2 * i) += noise(0, 0);
    update_.innovationCovariance(2 * i + 1, 2 * i) += noise(1, 0);
    update_.innovationCovariance(2 * i, 2 * i + 1) += noise(0, 1);
    update_.innovationCovariance(2 * i + 1, 2 * i + 1) += noise(1, 1);
    const Eigen::Vector2d residual = row.residual + seen(moved_.data());
    update_.residual(2 * i) = residual.x();
    update_.residual(2 * i + 1) = residual.y();
  }
}

bool FeatureFilter::isFarFromLinear(const CameraModel* camera) const {
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    Row now;
    if (!linearize(camera, measurements_[i], &now)) continue;
    const Row& row = rows_[i];
    const Eigen::Map<const Vector6d> by_camera(step_.data());
    const Eigen::Map<const Vector6d> by_pose(step_.data() + row.pose_at);
    Eigen::Vector2d expected = row.residual - row.J_pose * (by_pose - by_camera);
    if (row.feature_at >= 0) {
      expected -= row.J_feature * Eigen::Map<const Eigen::Vector3d>(step_.data() + row.feature_at);
    }
    const double variance = 0.5 * measurements_[i].noise.trace();
    if ((now.residual - expected).squaredNorm() > kFarFromLinear * kFarFromLinear * variance) {
      return true;
    }
  }
  return false;
}

// Gauss and Newton's iterations of the update: linearised where the means are, the prior where they
// were. The covariance is the prior's until the end.
bool FeatureFilter::correct(const CameraModel* camera, double chi2) {
  const int n = state_.size();
  for (int iteration = 0;; ++iteration) {
    if (!update_.solve()) {
      if (iteration == 0) return false;
      break;  // the means have moved as far as they could
    }
    if (iteration == 0 && !(update_.chi2() <= chi2)) return false;
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      step_[k] = update_.delta()[i] - moved_[k];
      moved_[k] = update_.delta()[i];
    }
    state_.correct(step_.data());
    if (iteration + 1 >= options_.max_iterations || !isFarFromLinear(camera)) break;
    state_.followScale(moved_.data());
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      (void)linearize(camera, measurements_[i], &rows_[i]);  // else: as it was
    }
    assemble();
  }
  update_.reduce(state_.covariance(), state_.stride());
  state_.followScale();
  return true;
}

// --- Features ------------------------------------------------------------------------------------

std::optional<ExpectedFeature> FeatureFilter::expect(const CameraModel& camera, int feature) const {
  const StateFeature& f = state_.features()[static_cast<std::size_t>(feature)];
  const StatePose& pose = state_.poses()[static_cast<std::size_t>(f.pose)];
  PointView view;
  if (!viewFeature(camera, state_.camera(), pose.T_w_s, f, &view)) return std::nullopt;
  const int a = pose.offset;
  const Matrix6d ca = state_.P<6, 6>(0, a);
  const Matrix6d between = state_.P<6, 6>(a, a) + state_.P<6, 6>(0, 0) - ca - ca.transpose();
  const Eigen::Matrix<double, 6, 3> with_feature =
      state_.P<6, 3>(a, f.offset) - state_.P<6, 3>(0, f.offset);
  const Eigen::Matrix2d cross = view.J_pose * with_feature * view.J_feature.transpose();
  return ExpectedFeature{
      view.at,
      view.J_pose * between * view.J_pose.transpose() +
          view.J_feature * state_.P<3, 3>(f.offset, f.offset) * view.J_feature.transpose() + cross +
          cross.transpose(),
      view.J_feature, view.J_forward};
}

void FeatureFilter::measure(const FeatureMatch& match) {
  const int pose = state_.features()[static_cast<std::size_t>(match.feature)].pose;
  measurements_.push_back({pose, match.feature, Eigen::Vector3d::Zero(), match.pixel,
                           noise_scale_ * noise_scale_ * match.covariance,
                           noise_scale_ * noise_scale_ * match.covariance -
                               noise_scale_ * noise_scale_ * match.covariance_once,
                           match.age});
}

bool FeatureFilter::fits(const CameraModel& camera, const FeatureMatch& match) const {
  const auto expected = expect(camera, match.feature);
  if (!expected) return false;
  const Eigen::Matrix2d S =
      expected->covariance + noise_scale_ * noise_scale_ * match.covariance_once;
  const Eigen::Vector2d r = match.pixel - expected->pixel;
  return r.dot(S.inverse() * r) <= options_.match_chi2;
}

void FeatureFilter::observeFeatures(const CameraModel& camera,
                                    std::span<const FeatureMatch> matches, int least,
                                    std::vector<char>* accepted) {
  state_.compact();
  accepted->assign(matches.size(), char{0});
  measurements_.clear();
  for (const FeatureMatch& match : matches) {
    if (!match.on_trial) measure(match);
  }
  if (!believeMost(camera, matches, least, accepted)) return;
  believeRest(camera, matches, accepted);
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (matches[i].on_trial) (*accepted)[i] = fits(camera, matches[i]) ? 1 : 0;
  }
}

bool FeatureFilter::believeMost(const CameraModel& camera, std::span<const FeatureMatch> matches,
                                int least, std::vector<char>* accepted) {
  linearizeAll(&camera);
  if (rows_.empty()) return least == 0;
  assemble();
  adaptNoise(matches);
  const int count = static_cast<int>(rows_.size());
  marked_.assign(rows_.size(), char{0});
  findConsensus(&update_.residual(0), &update_.innovationCovariance(0, 0),
                update_.innovationStride(), count, options_.match_chi2, options_.hypotheses,
                &marked_);
  refutable_.clear();
  for (const Measurement& m : measurements_) refutable_.push_back({m.excess, m.age});
  refuter_.refute(&update_.residual(0), &update_.innovationCovariance(0, 0),
                  update_.innovationStride(), refutable_, options_.match_chi2, &marked_);
  kept_.clear();
  std::size_t kept = 0;
  for (int i = 0; i < count; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (!marked_[k]) continue;
    kept_.push_back(2 * i);
    kept_.push_back(2 * i + 1);
    measurements_[kept] = measurements_[k];
    rows_[kept] = rows_[k];
    ++kept;
  }
  if (static_cast<int>(kept) < least) return false;
  measurements_.resize(kept);
  rows_.resize(kept);
  if (kept == 0) return true;
  update_.keep(kept_.data(), static_cast<int>(kept_.size()));
  if (correct(&camera, kEachIsGated)) noteAccepted(matches, accepted);
  return true;
}

// They were expected elsewhere only because the camera was, or too far off for a linear forecast.
void FeatureFilter::believeRest(const CameraModel& camera, std::span<const FeatureMatch> matches,
                                std::vector<char>* accepted) {
  measurements_.clear();
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!(*accepted)[i] && !matches[i].on_trial && fits(camera, matches[i])) measure(matches[i]);
  }
  linearizeAll(&camera);
  if (rows_.empty()) return;
  assemble();
  if (correct(&camera, kEachIsGated)) noteAccepted(matches, accepted);
}

void FeatureFilter::noteAccepted(std::span<const FeatureMatch> matches,
                                 std::vector<char>* accepted) const {
  std::size_t next = 0;  // both are in the same order
  for (std::size_t i = 0; i < matches.size() && next < measurements_.size(); ++i) {
    if (matches[i].feature != measurements_[next].feature) continue;
    (*accepted)[i] = 1;
    ++next;
  }
}

// The innovations of matches whose place was known better than they measure it say how good they
// are: their median, as if Gaussian.
void FeatureFilter::adaptNoise(std::span<const FeatureMatch> matches) {
  distances_.clear();
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const int k = 2 * static_cast<int>(i);
    Eigen::Matrix2d S;
    S << update_.innovationCovariance(k, k), update_.innovationCovariance(k + 1, k),
        update_.innovationCovariance(k + 1, k), update_.innovationCovariance(k + 1, k + 1);
    if (measurements_[i].noise.trace() < 0.5 * S.trace()) continue;
    distances_.push_back(rows_[i].residual.dot(S.inverse() * rows_[i].residual));
  }
  if (distances_.size() < 8 || 2 * distances_.size() < matches.size()) return;
  const auto middle = distances_.begin() + static_cast<std::ptrdiff_t>(distances_.size() / 2);
  std::nth_element(distances_.begin(), middle, distances_.end());
  const double ratio = std::clamp(*middle / kMedianOfChi2, 0.25, 4.0);
  noise_scale_ = std::clamp(noise_scale_ * std::pow(ratio, 0.5 * options_.noise_adaption), 1.0,
                            options_.max_noise_scale);
}

int FeatureFilter::addFeatureLike(std::span<const int> others, int anchor,
                                  const Eigen::Vector2d& uv, const Eigen::Matrix2d& uv_covariance,
                                  double rho_sigma_ratio) {
  state_.compact();
  std::fill(row_.begin(), row_.end(), 0.0);
  const double share = 1.0 / static_cast<double>(others.size());
  double rho = 0.0;
  for (const int other : others) {
    const StateFeature& feature = state_.features()[static_cast<std::size_t>(other)];
    const StatePose& pose = state_.poses()[static_cast<std::size_t>(feature.pose)];
    const auto view = viewDepth(state_.camera(), pose.T_w_s, feature);
    if (!view) return -1;
    rho += share * view->rho;
    Eigen::Map<Eigen::Matrix<double, 1, 6>> by_pose(row_.data() + pose.offset);
    Eigen::Map<Eigen::Matrix<double, 1, 6>> by_camera(row_.data());
    Eigen::Map<Eigen::RowVector3d> by_feature(row_.data() + feature.offset);
    by_pose += share * view->J_pose;
    by_camera -= share * view->J_pose;
    by_feature += share * view->J_feature;
  }
  if (!(rho > 0.0)) return -1;
  return state_.addFeature(anchor, uv, rho, featureCovariance(uv_covariance, rho_sigma_ratio * rho),
                           row_.data());
}

void FeatureFilter::removeEmptyAnchors() {
  for (std::size_t i = 0; i < state_.poses().size(); ++i) {
    const StatePose& pose = state_.poses()[i];
    if (pose.offset >= 0 && pose.kind == PoseKind::kAnchor && pose.features == 0) {
      state_.removePose(static_cast<int>(i));
    }
  }
}

int FeatureFilter::anchorCount() const {
  return static_cast<int>(std::count_if(
      state_.poses().begin(), state_.poses().end(),
      [](const StatePose& pose) { return pose.offset >= 0 && pose.kind == PoseKind::kAnchor; }));
}

}  // namespace waymark::slam
