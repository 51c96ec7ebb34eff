// A world of points for the filter's tests: a camera goes along a wall with relief, sees a marker
// at first, and then only points.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <random>
#include <vector>

#include "slam/natural/filter/feature_filter.h"
#include "slam/natural/filter/se3.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam::testing {

// Camera poses by time, seconds.
using Path = std::function<Transform(double)>;

// Along a wall, at 0.35 m/s, carried by a hand.
inline Path walk(unsigned seed, double speed_m_per_s = 0.35) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> phase(0.0, 6.28);
  std::array<double, 12> a{};
  for (double& v : a) v = phase(rng);
  return [=](double t) {
    const auto sway = [&](int i, double hz) {
      return std::sin(6.2832 * hz * t + a[static_cast<std::size_t>(i)]);
    };
    const Eigen::Vector3d eye(speed_m_per_s * t + 0.03 * sway(0, 0.4) + 0.01 * sway(1, 1.1),
                              0.05 * sway(2, 0.3), 0.03 * sway(3, 0.5) + 0.015 * sway(4, 1.6));
    Transform T =
        lookAt(eye, eye + Eigen::Vector3d(0.35 + 0.15 * sway(5, 0.2), 1.0, 0.08 * sway(6, 0.35)));
    T.R = T.R * expSo3({0.02 * sway(7, 1.3), 0.02 * sway(8, 0.9), 0.04 * sway(9, 0.45)});
    return T;
  };
}

struct PointWorldOptions {
  int features = 40;
  double rate_hz = 30.0;
  double sigma_px = 0.25;         // of a match
  double anchor_sigma_px = 0.25;  // of a feature's first bearing
  double marker_sigma_px = 0.1;
  double marker_map_sigma_m = 0.001;  // of the map's marker, metres; and radians
  double outliers = 0.0;              // share of the points that move
  int trial_frames = 8;               // until a new feature is believed
  // Points that the filter takes for better known than they are, for comparison.
  double believed_anchor_sigma_px = 0.0;  // 0: anchor_sigma_px
};

class PointWorld {
 public:
  PointWorld(unsigned seed, const Path& path, const PointWorldOptions& options,
             const FeatureFilterOptions& filter_options)
      : options_(options), path_(path), rng_(seed), filter_([&] {
          FeatureFilterOptions o = filter_options;
          o.max_features = options.features;
          return o;
        }()) {
    std::uniform_real_distribution<double> x(-4.0, 12.0);
    std::uniform_real_distribution<double> depth(1.4, 3.2);
    std::uniform_real_distribution<double> z(-2.0, 2.0);
    std::uniform_real_distribution<double> share(0.0, 1.0);
    for (int i = 0; i < 4000; ++i) {
      points_.push_back({x(rng_), depth(rng_), z(rng_)});
      moves_.push_back(share(rng_) < options.outliers);
    }
    point_of_.assign(static_cast<std::size_t>(options.features), -1);
    failures_.assign(static_cast<std::size_t>(options.features), 0);
    age_.assign(static_cast<std::size_t>(options.features), 0);
    // The map's marker is where the map is wrong by.
    true_marker_ = markerFacing({0.6, 1.8, 0.0}, {0.3, 0.0, 0.1});
    Vector6d off;
    for (int i = 0; i < 6; ++i) off[i] = options.marker_map_sigma_m * normal_(rng_);
    map_marker_ = true_marker_.retract(off);
    // The first pose is a rough one: what follows from the marker it learns from it.
    Vector6d rough;
    Vector6d sigma;
    sigma << 0.03, 0.03, 0.03, 0.02, 0.02, 0.02;
    for (int i = 0; i < 6; ++i) rough[i] = sigma[i] * normal_(rng_);
    filter_.start(path(0.0).retract(rough), Matrix6d(sigma.cwiseAbs2().asDiagonal()));
  }

  // One frame. marker, features: whether they are to be seen.
  void step(bool marker, bool features) {
    if (frame_ > 0) filter_.predict(1.0 / options_.rate_hz);
    time_s_ = frame_ / options_.rate_hz;
    ++frame_;
    truth_ = path_(time_s_);
    if (marker) observeMarker();
    if (!features) return;
    observePoints();
    addPoints();
  }

  // After step(): a marker that no map knows, where it is in view now. What the filter makes of it.
  MarkerOutcome showUnplaced(const Transform& T_w_m) {
    constexpr double kSize_m = 0.2;
    std::mt19937 corner_rng(rng_());
    const auto seen =
        observe(camera_, truth_, 8, T_w_m, kSize_m, options_.marker_sigma_px, &corner_rng);
    if (!seen) return {};
    const UnplacedMarker marker = unplacedMarker(*seen, kSize_m, camera_.focalLength(), {});
    return filter_.observeUnplaced({&marker, 1});
  }

  // Squared Mahalanobis distance of the published pose.
  [[nodiscard]] double nees() const {
    const Vector6d e = error();
    return e.dot(filter_.state().poseCovariance().ldlt().solve(e));
  }
  [[nodiscard]] Vector6d error() const { return filter_.state().camera().localCoordinates(truth_); }
  [[nodiscard]] double positionSigma() const {
    return std::sqrt(filter_.state().poseCovariance().topLeftCorner<3, 3>().trace());
  }
  [[nodiscard]] FeatureFilter& filter() { return filter_; }
  [[nodiscard]] const Transform& truth() const { return truth_; }
  [[nodiscard]] double time() const { return time_s_; }
  [[nodiscard]] int lastMatches() const { return last_matches_; }
  [[nodiscard]] int lastAccepted() const { return last_accepted_; }
  [[nodiscard]] int outliersAccepted() const { return outliers_accepted_; }

 private:
  [[nodiscard]] Eigen::Vector2d noise(double sigma) {
    return sigma * Eigen::Vector2d(normal_(rng_), normal_(rng_));
  }
  [[nodiscard]] Eigen::Vector3d pointAt(int point) const {
    const auto k = static_cast<std::size_t>(point);
    // Half of the moving ones go one way, half another.
    const double way = point % 2 == 0 ? 0.2 : -0.15;
    return points_[k] + (moves_[k] ? Eigen::Vector3d(way * time_s_, 0.0, 0.1 * time_s_)
                                   : Eigen::Vector3d(Eigen::Vector3d::Zero()));
  }
  [[nodiscard]] std::optional<Eigen::Vector2d> see(int point) const {
    const auto pixel = camera_.project(truth_.inverse() * pointAt(point));
    return pixel && camera_.inImage(*pixel, 6.0) ? pixel : std::nullopt;
  }

  void observeMarker() {
    std::mt19937 corner_rng(rng_());
    const auto seen =
        observe(camera_, truth_, 7, true_marker_, 0.2, options_.marker_sigma_px, &corner_rng);
    if (!seen) return;
    const double s = options_.marker_map_sigma_m;
    const KnownMarker marker = knownMarker(*seen, map_marker_, 0.2, s * s * Matrix6d::Identity());
    (void)filter_.observeMarkers({&marker, 1});
  }

  void observePoints() {
    matches_.clear();
    int believed = 0;
    for (int i = 0; i < options_.features; ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (filter_.state().features()[k].offset < 0) continue;
      const auto pixel = see(point_of_[k]);
      if (!pixel || !filter_.expect(camera_, i)) {
        forget(i);
        continue;
      }
      const double s = options_.sigma_px;
      matches_.push_back({i, *pixel + noise(s), s * s * Eigen::Matrix2d::Identity(),
                          s * s * Eigen::Matrix2d::Identity(), age_[k] < options_.trial_frames,
                          age_[k]});
      believed += !matches_.back().on_trial;
    }
    // Better some that may be wrong than none.
    if (believed < 12) {
      for (FeatureMatch& match : matches_) match.on_trial = false;
    }
    filter_.observeFeatures(camera_, matches_, 0, &accepted_);
    last_matches_ = static_cast<int>(matches_.size());
    last_accepted_ = static_cast<int>(std::count(accepted_.begin(), accepted_.end(), 1));
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      const int feature = matches_[i].feature;
      const auto k = static_cast<std::size_t>(feature);
      if (accepted_[i] && moves_[static_cast<std::size_t>(point_of_[k])]) ++outliers_accepted_;
      failures_[k] = accepted_[i] ? 0 : failures_[k] + 1;
      ++age_[k];
      if (failures_[k] > (matches_[i].on_trial ? 0 : 5) || filter_.state().features()[k].rho < 0.0)
        forget(feature);
    }
    filter_.removeEmptyAnchors();
  }

  void forget(int feature) {
    filter_.removeFeature(feature);
    point_of_[static_cast<std::size_t>(feature)] = -1;
  }

  void addPoints() {
    const int missing = options_.features - filter_.state().featureCount();
    if (missing < 4 || filter_.anchorCount() >= 12) return;
    const int anchor = filter_.addAnchor();
    if (anchor < 0) return;
    std::uniform_int_distribution<int> any(0, static_cast<int>(points_.size()) - 1);
    int added = 0;
    for (int tries = 0; tries < 3000 && added < missing; ++tries) {
      const int point = any(rng_);
      if (std::find(point_of_.begin(), point_of_.end(), point) != point_of_.end()) continue;
      const auto pixel = see(point);
      if (!pixel) continue;
      const auto uv = camera_.undistort(*pixel + noise(options_.anchor_sigma_px));
      if (!uv) continue;
      const double believed = options_.believed_anchor_sigma_px > 0.0
                                  ? options_.believed_anchor_sigma_px
                                  : options_.anchor_sigma_px;
      const double s = believed / camera_.focalLength();
      const double rho = 1.0 / 2.2;
      const Eigen::Vector3d variance(s * s, s * s, 0.25 * rho * rho);
      const int feature =
          filter_.addFeature(anchor, *uv, rho, Eigen::Matrix3d(variance.asDiagonal()));
      if (feature < 0) return;
      point_of_[static_cast<std::size_t>(feature)] = point;
      failures_[static_cast<std::size_t>(feature)] = 0;
      age_[static_cast<std::size_t>(feature)] = 0;
      ++added;
    }
    filter_.removeEmptyAnchors();
  }

  PointWorldOptions options_;
  Path path_;
  std::mt19937 rng_;
  std::normal_distribution<double> normal_{0.0, 1.0};
  CameraModel camera_{testCalibration()};
  FeatureFilter filter_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<bool> moves_;
  std::vector<int> point_of_;
  std::vector<int> failures_;
  std::vector<int> age_;  // frames
  std::vector<FeatureMatch> matches_;
  std::vector<char> accepted_;
  Transform true_marker_, map_marker_;
  Transform truth_;
  double time_s_ = 0.0;
  int frame_ = 0;
  int last_matches_ = 0;
  int last_accepted_ = 0;
  int outliers_accepted_ = 0;
};

}  // namespace waymark::slam::testing
