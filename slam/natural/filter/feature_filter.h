// The filter without images: an extended Kalman filter over FilterState, told what was seen of its
// points.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "slam/camera_pose/known_marker.h"
#include "slam/geometry/camera_model.h"
#include "slam/marker_pose/marker_resolver.h"
#include "slam/natural/filter/consensus.h"
#include "slam/natural/filter/filter_state.h"
#include "slam/natural/filter/kalman_update.h"
#include "slam/natural/filter/point_view.h"

namespace waymark::slam {

struct FeatureFilterOptions {
  // Features at a time. Their number squared is the time of an update: with 60 a whole frame takes
  // 1.3 to 1.5 ms of a slow core; the drift falls with its root.
  int max_features = 60;
  // Cameras that features were first seen from. More: fewer features at a time for each of them,
  // and so new ones sooner.
  int max_anchors = 12;
  // Fiducial markers in the state at a time; those beyond are not looked at.
  int max_markers = 6;
  // What is the same in all views of a marker's corner, in units of the sigma of one view: however
  // long it is looked at, the camera beside it is not known better than by one view with that
  // error. Less than MapCovarianceOptions::repeated_share, as the camera moves: of the variance
  // 0.18 is the same a second later while it stands still, 0.06 to 0 while it does not.
  double marker_repeated_share = 0.25;
  // Cameras of frames that others are still looking at (markPast()): the ring of past states.
  int max_past = 4;
  // Squared Mahalanobis distance of a match, two dimensions: 99 % are within 9.21. Smaller loses
  // good ones, larger believes wrong ones.
  double match_chi2 = 9.21;
  // The same of a fiducial marker's four corners, eight dimensions: 99.9 %.
  double marker_chi2 = 26.1;
  // ... and of an absolute pose, six dimensions: 99.9 %.
  double pose_chi2 = 22.5;
  // Matches that are tried as the one that is right. Half of them wrong, 20 miss once in a million.
  int hypotheses = 20;
  // A match's relinearisations where it is far from what was expected. More follow stronger jerks.
  int max_iterations = 3;
  // A fiducial marker that has not been seen for so long is forgotten, seconds; seen again it is as
  // the map has it then.
  double marker_memory_s = 1.0;
  // Share of the match noise's own estimate that a frame replaces. Larger follows changing images
  // faster, smaller is steadier.
  double noise_adaption = 0.02;
  // Matches are never taken for worse than so many times what they say of themselves.
  double max_noise_scale = 4.0;
  MotionNoiseOptions motion;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// A feature found in an image.
struct FeatureMatch {
  int feature = -1;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // pixels^2
  // Of its error in this frame alone: `covariance` is larger where that lasts for several.
  Eigen::Matrix2d covariance_once = Eigen::Matrix2d::Zero();
  // Compared with what is expected, but not believed yet: a point that moves gives itself away
  // once it has gone further than a depth could explain, and has moved nothing until then.
  bool on_trial = false;
  int age = 0;  // frames since it was first seen
};

struct ExpectedFeature {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  // What the state leaves open of it, without a measurement's own noise, pixels^2.
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  Matrix23d J_feature = Matrix23d::Zero();                    // d pixel / d (u, v, rho)
  Eigen::RowVector3d J_forward = Eigen::RowVector3d::Zero();  // PointView
};

// A marker in view that the map has no place for.
struct UnplacedMarker {
  const MarkerDetection* detection = nullptr;  // as at the middle row's time
  double size_m = 0.0;
  // As its corners have it; empty where they leave two poses open.
  std::optional<Transform> T_c_m;
};
// The detection must outlive it. focal_px: for the ambiguity of squares.
[[nodiscard]] UnplacedMarker unplacedMarker(const MarkerDetection& detection, double size_m,
                                            double focal_px, const MarkerResolverOptions& options);

struct MarkerOutcome {
  int used = 0;
  int refused = 0;   // contradict what the filter knows
  int left_out = 0;  // no place for them, or not to be seen from here
};

enum class PoseOutcome : std::uint8_t { kUsed, kRefused, kUnknownFrame };

class FeatureFilter {
 public:
  explicit FeatureFilter(const FeatureFilterOptions& options);

  // Anew, with nothing but a camera; covariance: of (dp, dtheta) as Transform::retract. Where the
  // markers that it comes from are about to be given to observeMarkers() as well, a wide one: they
  // would count twice.
  void start(const Transform& T_w_c, const Matrix6d& covariance);

  void predict(double dt_s);

  // Markers in view, with what the map does not know of them: their poses become part of the state
  // when first seen, so that the map's errors stay what they are however often they are seen. What
  // one marker's error has in common with another's is not known here.
  MarkerOutcome observeMarkers(std::span<const KnownMarker> markers);

  // After observeMarkers(), where there are none of those: a marker's place becomes part of the
  // state, as seen from here, and from its next image on the size of its print tells how far the
  // camera has gone. One that contradicts what the filter knows is forgotten, and begins anew.
  MarkerOutcome observeUnplaced(std::span<const UnplacedMarker> markers);

  // Where a feature is expected; empty where the camera cannot see it.
  [[nodiscard]] std::optional<ExpectedFeature> expect(const CameraModel& camera, int feature) const;
  // Matches of one frame, each feature at most once: those that belong together are believed, and
  // those on trial compared with what follows. Where fewer than `least` belong together, none is.
  // accepted: one for each.
  void observeFeatures(const CameraModel& camera, std::span<const FeatureMatch> matches, int least,
                       std::vector<char>* accepted);

  // The camera of this frame in the world, found elsewhere. covariance: as start().
  [[nodiscard]] PoseOutcome observePose(const Transform& T_w_c, const Matrix6d& covariance);
  // The camera of this frame will be spoken of later. The oldest one is forgotten for it.
  //
  // It becomes a pose of the state, a place in the ring: what is said of it later corrects the
  // present by what the two have in common, which is what repeating all updates since then from a
  // stored state would give, to first order, at the cost of one update.
  void markPast(std::uint64_t frame);
  // Nobody will speak of those marked so far any more.
  void forgetPast();
  // The camera of a frame that was marked, as the filter has it by now.
  [[nodiscard]] std::optional<Transform> pastPose(std::uint64_t frame) const;
  // From there to the present one, whatever the world is.
  struct Motion {
    Transform T_p_c;
    // Of (dp, dtheta) as Transform::retract, in the frame of the past camera.
    Matrix6d covariance = Matrix6d::Zero();
  };
  [[nodiscard]] std::optional<Motion> motionSince(std::uint64_t frame) const;
  // Whether that agrees with what is said of it; kUsed, and nothing is used yet, if it does.
  [[nodiscard]] PoseOutcome comparePastPose(std::uint64_t frame, const Transform& T_w_c,
                                            const Matrix6d& covariance) const;
  // As observePose(), of a frame that was marked, which is then forgotten.
  [[nodiscard]] PoseOutcome observePastPose(std::uint64_t frame, const Transform& T_w_c,
                                            const Matrix6d& covariance);
  // Everything is `scale` times as far from the camera of a marked frame as it was taken to be;
  // sigma: of its logarithm. False when it was not marked.
  [[nodiscard]] bool rescaleFromPast(std::uint64_t frame, double scale, double sigma);
  // As observePastPose(), where the filter is wrong and the other is right: everything moves with
  // that frame. False when it was not marked.
  [[nodiscard]] bool restartFromPast(std::uint64_t frame, const Transform& T_w_c,
                                     const Matrix6d& covariance);

  // A camera that features can be added to; -1 when there is no place.
  [[nodiscard]] int addAnchor() { return state_.clonePose(PoseKind::kAnchor, ++last_anchor_); }
  // The same of an earlier camera that was forgotten, with what was known of it then: covariance as
  // start(), which nothing else has anything in common with.
  [[nodiscard]] int addAnchor(const Transform& T_w_a, const Matrix6d& covariance);
  // What is known of an anchor: as start().
  [[nodiscard]] Matrix6d anchorCovariance(int anchor) const;
  [[nodiscard]] int addFeature(int anchor, const Eigen::Vector2d& uv, double rho,
                               const Eigen::Matrix3d& covariance) {
    return state_.addFeature(anchor, uv, rho, covariance);
  }
  // One that is taken to be as deep as the mean of others: their inverse depth in the camera as it
  // is, which the anchor is a copy of. What is not known of theirs is not known of its own either,
  // beside what the covariance adds: it tells nothing about the scale of what is there. -1, too,
  // when that is no depth in front of the camera. Precondition: at least one other.
  [[nodiscard]] int addFeatureLike(std::span<const int> others, int anchor,
                                   const Eigen::Vector2d& uv, const Eigen::Matrix2d& uv_covariance,
                                   double rho_sigma_ratio);
  void removeFeature(int feature) { state_.removeFeature(feature); }
  // Anchors without features.
  void removeEmptyAnchors();
  // Anchors in use.
  [[nodiscard]] int anchorCount() const;

  [[nodiscard]] const FilterState& state() const { return state_; }
  // As FilterState's.
  [[nodiscard]] double scaleSigma() { return state_.scaleSigma(); }
  // As FilterState: the world's coordinates have changed.
  void moveWorld(const Transform& T_new_old) { state_.moveWorld(T_new_old); }
  // How many times worse matches fit than their covariances say; at least 1.
  [[nodiscard]] double noiseScale() const { return noise_scale_; }

 private:
  struct Measurement {
    int pose = -1;
    int feature = -1;  // -1: p_s, in normalized coordinates
    Eigen::Vector3d p_s = Eigen::Vector3d::Zero();
    Eigen::Vector2d seen = Eigen::Vector2d::Zero();
    Eigen::Matrix2d noise = Eigen::Matrix2d::Zero();
    Eigen::Matrix2d excess = Eigen::Matrix2d::Zero();  // of the noise: what lasts for frames
    int age = 0;
  };
  struct Row {
    int pose_at = 0;
    int feature_at = -1;
    Matrix26d J_pose;
    Matrix23d J_feature;
    Eigen::Vector2d residual;
  };
  [[nodiscard]] bool linearize(const CameraModel* camera, const Measurement& m, Row* row) const;
  // measurements_ that can be seen, linearised: rows_.
  void linearizeAll(const CameraModel* camera);
  // rows_ into update_, as seen from where the update began.
  void assemble();
  // After assemble(): the means move and are linearised anew where that matters; then the
  // covariance is reduced. False, and nothing has changed, when that is impossible or what was seen
  // is further off than chi2.
  bool correct(const CameraModel* camera, double chi2);
  [[nodiscard]] bool isFarFromLinear(const CameraModel* camera) const;
  // The place in the state of a marker that has one, which is in view once more.
  [[nodiscard]] std::optional<int> seenMarker(std::uint64_t id);
  // The same, or a new one; empty where there is none.
  [[nodiscard]] std::optional<int> markerPlace(const KnownMarker& marker);
  [[nodiscard]] std::optional<int> markerPlace(const UnplacedMarker& marker);
  void forgetMarker(std::uint64_t id);
  void forgetMarkers();
  // False where they contradict what is known.
  bool observeCorners(int place, const std::array<Eigen::Vector3d, 4>& corners_m,
                      const MarkerDetection& detection, MarkerOutcome* outcome);
  void adaptNoise(std::span<const FeatureMatch> matches);
  void measure(const FeatureMatch& match);
  // The consensus of measurements_; whether there is one of that size.
  bool believeMost(const CameraModel& camera, std::span<const FeatureMatch> matches, int least,
                   std::vector<char>* accepted);
  // Those not accepted yet that fit by themselves now.
  void believeRest(const CameraModel& camera, std::span<const FeatureMatch> matches,
                   std::vector<char>* accepted);
  void noteAccepted(std::span<const FeatureMatch> matches, std::vector<char>* accepted) const;
  [[nodiscard]] bool fits(const CameraModel& camera, const FeatureMatch& match) const;
  // How far a pose of the state is from what was measured of it.
  struct PoseInnovation {
    Vector6d residual = Vector6d::Zero();
    Matrix6d noise = Matrix6d::Zero();
    double chi2 = 0.0;
  };
  [[nodiscard]] PoseInnovation innovationAt(int offset, const Transform& T_w_s,
                                            const Transform& measured,
                                            const Matrix6d& covariance) const;
  [[nodiscard]] PoseOutcome observePoseAt(int offset, const Transform& T_w_s,
                                          const Transform& measured, const Matrix6d& covariance);

  FeatureFilterOptions options_;
  FilterState state_;
  KalmanUpdate update_;
  double noise_scale_ = 1.0;
  double time_s_ = 0.0;  // since the start
  struct MarkerSeen {
    std::uint64_t id = 0;
    double time_s = 0.0;
  };
  std::vector<MarkerSeen> markers_seen_;
  std::vector<std::uint64_t> past_order_;  // oldest first
  std::uint64_t last_anchor_ = 0;          // anchors are numbered

  // Of the update under way.
  std::vector<Measurement> measurements_;
  std::vector<Row> rows_;
  Refuter refuter_;
  std::vector<Refuter::Match> refutable_;
  std::vector<char> marked_;
  std::vector<int> kept_;
  std::vector<double> moved_;  // from where the update began
  std::vector<double> step_;
  std::vector<double> row_;  // a derivative by all coordinates
  std::vector<double> distances_;
};

}  // namespace waymark::slam
