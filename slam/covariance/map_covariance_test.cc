#include "slam/covariance/map_covariance.h"

#include <random>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "slam/camera/rolling_shutter.h"
#include "slam/camera/undistort_map.h"
#include "slam/covariance/pose_by_camera.h"
#include "slam/optimization/map_optimizer.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

// Of the position.
double variance_m2(const Matrix6d& covariance) { return covariance.topLeftCorner<3, 3>().trace(); }

constexpr double kSize_m = 0.2;
constexpr double kSigma_px = 0.1;
const PoseGlobalMatrix kCameraAsItIs = PoseGlobalMatrix::Zero();

double neesOf(const Transform& estimate, const Transform& truth, const Matrix6d& covariance) {
  const Vector6d error = estimate.localCoordinates(truth);
  return error.dot(covariance.llt().solve(error));
}

class MapCovarianceTest : public ::testing::Test {
 protected:
  explicit MapCovarianceTest(unsigned seed = 3) : rng_(seed) {
    markers_ = testing::roomMarkers(28, 2.5, &rng_);
    options_.size_m = kSize_m;
    covariance_options_.repeated_share = 0.0;  // each view's noise is its own
  }

  // As the optimization makes it of noisy views.
  Map optimizedMap(double to_rad = 4.0) {
    Map map = testing::trueMap(camera_, testing::roomViews(0.0, to_rad, 16), markers_, kSize_m,
                               kSigma_px, &rng_);
    (void)optimizeGlobally(&map, options_, {.max_iterations = 30, .min_relative_decrease = 1e-9});
    return map;
  }

  struct Frame {
    std::vector<MarkerDetection> detections;
    std::vector<KnownMarker> known;
    PoseSolution solution;
  };
  void look(const Map& map, const Transform& truth, Frame* frame) {
    frame->detections = testing::observeAll(camera_, truth, markers_, kSize_m, kSigma_px, &rng_);
    frame->known = knownMarkers(map, frame->detections);
    const auto solution = PoseOptimizer(camera_.focalLength()).optimize(frame->known, truth);
    ASSERT_TRUE(solution);
    frame->solution = *solution;
  }

  std::mt19937 rng_;
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_;
  MarkerOptions options_;
  MapCovarianceOptions covariance_options_;
  CameraUncertainty known_camera_;
};

// The consistency test: seeded rooms, mapped from noisy views, and new frames in them.
TEST_F(MapCovarianceTest, ThePoseInTheWorldErrsAsItSays) {
  constexpr int kRuns = 1000;
  double here = 0.0;
  double far = 0.0;
  double relative_only = 0.0;
  double of_markers = 0.0;
  int marker_count = 0;
  for (int run = 0; run < kRuns; ++run) {
    Map map = optimizedMap();
    MapCovariance covariance(options_, covariance_options_, known_camera_, map);
    covariance.recover(1.0, &map);
    Frame near_start;
    Frame at_end;
    const Transform near_truth = testing::roomView(0.3);
    const Transform end_truth = testing::roomView(3.7);
    look(map, near_truth, &near_start);
    look(map, end_truth, &at_end);
    here += neesOf(near_start.solution.T_w_c, near_truth,
                   covariance.inWorld(near_start.solution, near_start.known, kCameraAsItIs)) /
            kRuns;
    far += neesOf(at_end.solution.T_w_c, end_truth,
                  covariance.inWorld(at_end.solution, at_end.known, kCameraAsItIs)) /
           kRuns;
    relative_only += neesOf(at_end.solution.T_w_c, end_truth, at_end.solution.covariance) / kRuns;
    for (const auto& [id, marker] : map.markers()) {
      const Transform& truth = markers_[static_cast<std::size_t>(id)].T_w_m;
      of_markers += neesOf(*marker.T_w_m, truth, marker.world_covariance);
      ++marker_count;
    }
  }
  // 95 % of the means of 1000 draws of chi-square with 6 degrees of freedom: 6 +- 0.2; and some
  // room for what is not linear.
  EXPECT_NEAR(here, 6.0, 0.5);
  EXPECT_NEAR(far, 6.0, 0.5);
  EXPECT_NEAR(of_markers / marker_count, 6.0, 0.5);
  EXPECT_GT(relative_only, 30.0) << "the map's share is what this is about";
}

// A room mapped, and looked at, by a moving camera with a rolling shutter that nobody knows.
TEST_F(MapCovarianceTest, WhatIsNotKnownOfTheCameraIsInPosesAndMarkers) {
  constexpr int kRuns = 300;
  constexpr double kReadout_s = 0.01;
  CameraUncertainty uncertain{.camera = &camera_};
  uncertain.covariance(9, 9) = kReadout_s * kReadout_s;
  std::normal_distribution<double> readout(0.0, kReadout_s);
  Twist twist;
  twist << 0.4, 0.1, -0.2, 0.1, 0.4, 0.2;
  double nees = 0.0;
  double map_held = 0.0;
  double of_markers = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    const double late_s = readout(rng_);
    Map map = testing::trueMap(camera_, testing::roomViews(0.0, 4.0, 16), markers_, kSize_m,
                               kSigma_px, &rng_);
    for (const auto& [id, keyframe] : map.keyframes()) {
      map.setKeyframeTwist(id, (id % 2 == 0 ? 1.0 : -0.5) * twist);
    }
    undistortAgain(camera_, -late_s, &map);
    (void)optimizeGlobally(&map, options_, {.max_iterations = 30, .min_relative_decrease = 1e-9});
    MapCovariance covariance(options_, covariance_options_, uncertain, map);
    covariance.recover(1.0, &map);
    Frame frame;
    const Transform truth = testing::roomView(3.7);
    frame.detections = testing::observeAll(camera_, truth, markers_, kSize_m, kSigma_px, &rng_);
    for (MarkerDetection& seen : frame.detections) {
      const auto& marker = markers_[static_cast<std::size_t>(seen.id)];
      const auto skewed = deskewed(seen, camera_, truth, twist, marker.T_w_m, kSize_m, -late_s);
      ASSERT_TRUE(skewed);
      seen = *skewed;
    }
    frame.known = knownMarkers(map, frame.detections);
    const auto solution = PoseOptimizer(camera_.focalLength()).optimize(frame.known, truth);
    ASSERT_TRUE(solution);
    const PoseGlobalMatrix in_view = poseByCamera(*solution, frame.known, uncertain, twist, 0);
    nees +=
        neesOf(solution->T_w_c, truth, covariance.inWorld(*solution, frame.known, in_view)) / kRuns;
    MapCovariance of_map(options_, covariance_options_, known_camera_, map, /*grows=*/false);
    of_map.recover(1.0, &map);
    const Matrix6d share = in_view * uncertain.covariance * in_view.transpose();
    map_held += neesOf(solution->T_w_c, truth,
                       of_map.inWorld(*solution, frame.known, kCameraAsItIs) + share) /
                kRuns;
    const MapMarker& far = *map.find(17);
    of_markers += neesOf(*far.T_w_m, markers_[17].T_w_m, far.world_covariance) / kRuns;
  }
  EXPECT_NEAR(nees, 6.0, 0.8);
  EXPECT_NEAR(of_markers, 6.0, 0.8);
  EXPECT_GT(map_held, 12.0) << "the map's part of it is what this is about";
}

// Corners that are found a little off in the same way whenever they are seen. (How a marker is
// printed does that, too; this is how it looks.)
TEST_F(MapCovarianceTest, AMarkerIsNoBetterKnownThanWhatAllItsViewsHaveInCommon) {
  constexpr int kRuns = 200;
  constexpr double kShare = 0.5;
  const double shared_sigma = kShare * kSigma_px / camera_.focalLength();
  std::normal_distribution<double> noise(0.0, shared_sigma);
  double told = 0.0;
  double ignored = 0.0;
  int marker_count = 0;
  MapCovarianceOptions with_share = covariance_options_;
  with_share.repeated_share = kShare;
  for (int run = 0; run < kRuns; ++run) {
    Map map = testing::trueMap(camera_, testing::roomViews(0.0, 1.0, 40), markers_, kSize_m,
                               kSigma_px, &rng_);
    const Map clean = map;
    for (const auto& [id, marker] : clean.markers()) {
      std::array<Eigen::Vector2d, 4> off;
      for (Eigen::Vector2d& corner : off) corner = {noise(rng_), noise(rng_)};
      for (const KeyframeId view : clean.viewsOf(id)) {
        MarkerDetection seen = *clean.keyframes().at(view).find(id);
        for (std::size_t k = 0; k < 4; ++k) seen.normalized[k] += off[k];
        map.removeViews(id, {&view, 1});
        map.addView(view, seen);
      }
    }
    (void)optimizeGlobally(&map, options_, {.max_iterations = 30, .min_relative_decrease = 1e-9});
    for (const auto* options : {&covariance_options_, &with_share}) {
      MapCovariance(options_, *options, known_camera_, map).recover(1.0, &map);
      for (const auto& [id, marker] : map.markers()) {
        const Transform& truth = markers_[static_cast<std::size_t>(id)].T_w_m;
        const double nees = neesOf(*marker.T_w_m, truth, marker.world_covariance);
        (options == &with_share ? told : ignored) += nees;
        if (options == &with_share) ++marker_count;
      }
    }
  }
  EXPECT_NEAR(told / marker_count, 6.0, 1.5);
  EXPECT_GT(ignored / marker_count, 12.0);
}

TEST_F(MapCovarianceTest, InSlicesItComesToTheSame) {
  Map map = optimizedMap();
  Map sliced_map = map;
  MapCovariance at_once(options_, covariance_options_, known_camera_, map);
  at_once.recover(1.0, &map);
  covariance_options_.cost_per_frame = 2.0;
  MapCovariance sliced(options_, covariance_options_, known_camera_, sliced_map);
  sliced.noteChange();
  int frames = 0;
  while (sliced_map.markers().at(3).world_covariance.isZero(0.0)) {
    ASSERT_LT(++frames, 1000);
    sliced.work(1.0, &sliced_map);
  }
  EXPECT_GT(frames, 5);
  EXPECT_EQ(map.markers().at(3).world_covariance, sliced_map.markers().at(3).world_covariance);
}

// What was begun in coordinates that are no more is begun anew.
TEST_F(MapCovarianceTest, BeginsAnewInANewWorld) {
  Map map = optimizedMap();
  MapCovariance covariance(options_, covariance_options_, known_camera_, map);
  covariance.work(1.0, &map);
  const Transform T_v_w{expSo3({0.0, 0.0, 0.5}), {10.0, 0.0, 0.0}};
  map.moveWorld(T_v_w);
  for (int i = 0; i < 2000; ++i) covariance.work(1.0, &map);
  Map moved = map;
  MapCovariance of_moved(options_, covariance_options_, known_camera_, moved);
  of_moved.recover(1.0, &moved);
  EXPECT_EQ(map.markers().at(3).world_covariance, moved.markers().at(3).world_covariance);
}

// Markers that were placed since hang on those that were there.
TEST_F(MapCovarianceTest, NewMarkersAreNoSurerThanTheirNeighbours) {
  Map map = optimizedMap();
  Map without_last = map;
  MapCovariance all(options_, covariance_options_, known_camera_, map);
  all.recover(1.0, &map);
  Frame frame;
  look(map, testing::roomView(3.7), &frame);
  ASSERT_GE(frame.known.size(), 3U);
  without_last.ban(frame.known.back().detection->id);
  MapCovariance before(options_, covariance_options_, known_camera_, without_last);
  before.recover(1.0, &without_last);
  const double expected = variance_m2(all.inWorld(frame.solution, frame.known, kCameraAsItIs));
  const double hanging = variance_m2(before.inWorld(frame.solution, frame.known, kCameraAsItIs));
  EXPECT_GT(hanging, 0.8 * expected);
  EXPECT_LT(hanging, 2.0 * expected);
}

// A marker that is known well from elsewhere comes into view beside others that are new: what is
// not known of these stays, until they have been brought together.
TEST_F(MapCovarianceTest, AMarkerFromElsewhereDoesNotVouchForNewOnes) {
  Map map = optimizedMap();
  MapCovariance covariance(options_, covariance_options_, known_camera_, map);
  covariance.recover(1.0, &map);
  Frame near_start;
  look(map, testing::roomView(0.0), &near_start);
  Frame frame;
  look(map, testing::roomView(3.7), &frame);
  ASSERT_GE(frame.known.size(), 3U);
  const double doubt = variance_m2(covariance.follow(frame.solution, frame.known));
  for (std::size_t i = 0; i < frame.detections.size(); ++i) {
    frame.detections[i].id =
        i == 0 ? near_start.known.front().detection->id : 100 + static_cast<int>(i);
  }
  const double sure = variance_m2(map.find(frame.detections[0].id)->world_covariance);
  const double beside = variance_m2(covariance.inWorld(frame.solution, frame.known, kCameraAsItIs));
  EXPECT_LT(sure, 0.1 * doubt) << "or this tells nothing";
  EXPECT_GT(beside, 0.3 * doubt);
  EXPECT_LT(beside, 1.5 * doubt);
}

// Where all are new, what the last frame's place was sure of holds.
TEST_F(MapCovarianceTest, AmongNewMarkersTheLastDoubtHolds) {
  Map map = optimizedMap();
  MapCovariance covariance(options_, covariance_options_, known_camera_, map);
  covariance.recover(1.0, &map);
  Frame frame;
  look(map, testing::roomView(3.7), &frame);
  const Matrix6d known = covariance.follow(frame.solution, frame.known);
  std::vector<MarkerDetection> renamed = frame.detections;
  std::vector<KnownMarker> strangers = frame.known;
  for (std::size_t i = 0; i < strangers.size(); ++i) {
    renamed[i].id += 100;
    strangers[i].detection = &renamed[i];
  }
  const Matrix6d among_new = covariance.follow(frame.solution, strangers);
  EXPECT_GT(variance_m2(among_new), 0.9 * variance_m2(known));
}

TEST_F(MapCovarianceTest, OffItIsThatOfTheSolution) {
  covariance_options_.enabled = false;
  Map map = optimizedMap();
  MapCovariance covariance(options_, covariance_options_, known_camera_, map);
  covariance.recover(1.0, &map);
  Frame frame;
  look(map, testing::roomView(1.0), &frame);
  EXPECT_EQ(covariance.follow(frame.solution, frame.known), frame.solution.covariance);
  EXPECT_TRUE(map.markers().at(3).world_covariance.isZero(0.0));
}

// Poses profit from what is recovered, but the map stays as it was.
TEST_F(MapCovarianceTest, AMapThatDoesNotGrowStaysAsItIs) {
  Map map = optimizedMap();
  MapCovariance covariance(options_, covariance_options_, known_camera_, map, /*grows=*/false);
  Frame frame;
  look(map, testing::roomView(1.0), &frame);
  const double before_m2 =
      variance_m2(covariance.inWorld(frame.solution, frame.known, kCameraAsItIs));
  covariance.recover(1.0, &map);
  EXPECT_TRUE(map.markers().at(3).world_covariance.isZero(0.0));
  EXPECT_GT(variance_m2(covariance.inWorld(frame.solution, frame.known, kCameraAsItIs)),
            1.5 * before_m2);
}

// The largest ratio of two covariances in any direction.
double largestRatio(const Matrix6d& a, const Matrix6d& b) {
  const Eigen::LLT<Matrix6d> factor(b);
  const Matrix6d half = factor.matrixL().solve(a);
  const Matrix6d whitened = factor.matrixL().solve(half.transpose());
  return whitened.selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff();
}

TEST_F(MapCovarianceTest, FramesFromNearlyTheSamePlaceTakeWhatWasComputed) {
  Map map = optimizedMap();
  MapCovariance covariance(options_, covariance_options_, known_camera_, map);
  covariance.recover(1.0, &map);
  const Transform truth = testing::roomView(2.0);
  Frame first;
  Frame next;
  look(map, truth, &first);
  Transform moved = truth;
  moved.p += Eigen::Vector3d(0.01, -0.008, 0.006);
  look(map, moved, &next);
  ASSERT_EQ(first.known.size(), next.known.size());
  EXPECT_EQ(covariance.follow(first.solution, first.known),
            covariance.inWorld(first.solution, first.known, kCameraAsItIs));
  const Matrix6d kept = covariance.follow(next.solution, next.known);
  const Matrix6d exact = covariance.inWorld(next.solution, next.known, kCameraAsItIs);
  EXPECT_NE(kept, exact);
  EXPECT_LT(largestRatio(kept, exact), 1.06);
  EXPECT_LT(largestRatio(exact, kept), 1.06);
}

TEST_F(MapCovarianceTest, ItIsComputedAnewWhereSomethingIsAnother) {
  Map map = optimizedMap();
  MapCovariance covariance(options_, covariance_options_, known_camera_, map);
  covariance.recover(1.0, &map);
  const Transform truth = testing::roomView(2.0);
  Frame first;
  look(map, truth, &first);
  const auto isExact = [&](const Frame& frame) {
    (void)covariance.follow(first.solution, first.known);
    return covariance.follow(frame.solution, frame.known) ==
           covariance.inWorld(frame.solution, frame.known, kCameraAsItIs);
  };
  Frame same = first;
  same.solution.T_w_c.p.x() += 0.001;
  EXPECT_FALSE(isExact(same));

  Frame away = first;
  away.solution.T_w_c.p.x() += 0.2;
  EXPECT_TRUE(isExact(away));
  Frame turned = first;
  turned.solution.T_w_c =
      turned.solution.T_w_c.retract((Vector6d() << 0, 0, 0, 0, 0, 0.1).finished());
  EXPECT_TRUE(isExact(turned));
  Frame fewer = same;
  fewer.solution.inlier.set(1, false);
  EXPECT_TRUE(isExact(fewer));
  Frame blurred = same;
  for (MarkerDetection& detection : blurred.detections) {
    for (Eigen::Matrix2d& corner : detection.covariance) corner *= 1.5;
  }
  blurred.known = knownMarkers(map, blurred.detections);
  EXPECT_TRUE(isExact(blurred));

  (void)covariance.follow(first.solution, first.known);
  covariance.recover(1.0, &map);
  EXPECT_EQ(covariance.follow(same.solution, same.known),
            covariance.inWorld(same.solution, same.known, kCameraAsItIs));
}

// In a map that changes with each frame.
TEST_F(MapCovarianceTest, RestsAfterARecoveryButNotInANewWorld) {
  covariance_options_.cost_per_frame = 1e9;
  covariance_options_.rest = 4.0;
  Map map = optimizedMap();
  MapCovariance covariance(options_, covariance_options_, known_camera_, map);
  const auto work = [&] {
    covariance.noteChange();
    return covariance.work(1.0, &map);
  };
  EXPECT_TRUE(work());
  for (int i = 0; i < 4; ++i) EXPECT_FALSE(work()) << i;
  EXPECT_TRUE(work());
  EXPECT_FALSE(work());
  map.moveWorld({expSo3({0.0, 0.0, 1.0}), {1.0, 2.0, 3.0}});
  EXPECT_TRUE(work());
}

TEST_F(MapCovarianceTest, ItsOptionsAreChecked) {
  EXPECT_TRUE(covariance_options_.invalidReason().empty());
  covariance_options_.cost_per_frame = 0.0;
  EXPECT_NE(covariance_options_.invalidReason(), "");
  covariance_options_ = {};
  covariance_options_.rest = -1.0;
  EXPECT_NE(covariance_options_.invalidReason(), "");
}

}  // namespace
}  // namespace waymark::slam
