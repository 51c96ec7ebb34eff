#include "slam/loop_closure/loop_closure_manager.h"

#include <algorithm>
#include <numbers>
#include <optional>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "slam/optimization/map_optimizer.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.25;
constexpr double kSigmaPx = 0.05;
constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kBudget = 50.0;  // of a frame
constexpr int kFramesBetweenAttempts = 10;
constexpr int kForever = 10'000;  // frames

// What tracking makes of an image; owns what TrackedFrame refers to.
struct SeenFrame {
  std::vector<MarkerDetection> detections;
  std::vector<MarkerDetection> fitting;
  SplitMarkers markers;
  TrackedFrame tracked;
};

// Somebody turned round in a room, up to the keyframe at 320 degrees, and goes on to where markers
// from the beginning are in view again beside the last ones.
class LoopClosureManagerTest : public ::testing::Test {
 protected:
  static constexpr KeyframeId kLast = 32;
  static constexpr int kLoopMarker = 23;  // at 345 degrees, which the first keyframes saw

  LoopClosureManagerTest() {
    options_.size_m = kSize;
    markers_ = testing::roomMarkers(24, 2.5, &rng_);
    map_ = testing::trueMap(camera_, testing::roomViews(0.0, 320.0 * kDegree, kLast + 1), markers_,
                            kSize, kSigmaPx, &rng_);
  }

  void bendMap() {
    testing::bend((Vector6d() << 0.25, -0.15, 0.1, 0.02, -0.03, 0.12).finished(), &map_);
  }
  // The map is as good as corners can make it, but a marker hangs elsewhere by now.
  void moveMarker(int id, const Eigen::Vector3d& by_m) {
    (void)optimizeGlobally(&map_, options_, {.max_iterations = 50});
    markers_[static_cast<std::size_t>(id)].T_w_m.p += by_m;
  }
  void moveLoopMarker() { moveMarker(kLoopMarker, {-0.05, -0.12, 0.15}); }

  // The next frame: what the camera sees, tracked by the neighbourhood of the last keyframe.
  // misfit: a marker that does not fit the others; -1 for none.
  [[nodiscard]] SeenFrame look(double degrees, int misfit = -1) {
    ++sequence_;
    SeenFrame frame;
    const Keyframe& last = map_.keyframes().at(kLast);
    local_.update(map_, last.detections, last.T_w_c, 2.0, KeyframeOptions{});
    frame.detections = testing::observeAll(camera_, testing::roomView(degrees * kDegree), markers_,
                                           kSize, kSigmaPx, &rng_);
    local_.split(knownMarkers(map_, frame.detections), &frame.markers);
    TrackedFrame& tracked = frame.tracked;
    tracked.time = {sequence_, static_cast<std::int64_t>(sequence_) * testing::kFramePeriodNs};
    tracked.eligible = frame.markers.eligible;
    tracked.loop = frame.markers.loop;
    std::vector<KnownMarker> inliers(tracked.eligible.begin(), tracked.eligible.end());
    std::erase_if(inliers, [&](const KnownMarker& m) { return m.detection->id == misfit; });
    tracked.solution = optimizer_.optimize(inliers, last.T_w_c).value();
    tracked.solution.inlier.assign(tracked.eligible.size(), true);
    for (std::size_t i = 0; i < tracked.eligible.size(); ++i) {
      const MarkerDetection& detection = *tracked.eligible[i].detection;
      tracked.solution.inlier.set(i, detection.id != misfit);
      if (detection.id != misfit) frame.fitting.push_back(detection);
    }
    tracked.fitting = frame.fitting;
    return frame;
  }
  // A frame that sees both ends, of the beginning one marker.
  LoopJunction meetLoop(double residual_sigma = 1.0) {
    const SeenFrame frame = look(kClosing_deg);
    EXPECT_EQ(frame.markers.loop.size(), 1U);
    return manager_.closeOrJoin(map_, residual_sigma, frame.tracked, frame.fitting);
  }
  // Frames until the closure under way is done.
  int workToTheEnd(double budget) {
    int frames = 0;
    for (; !manager_.isDone() && frames < kForever; ++frames) manager_.work(budget);
    return frames;
  }
  // A loop is met, tested and rejected.
  void meetAndReject(double residual_sigma = 1.0) {
    EXPECT_FALSE(meetLoop(residual_sigma).joins);
    ASSERT_FALSE(manager_.idle());
    EXPECT_LT(workToTheEnd(kBudget), kForever);
    EXPECT_FALSE(manager_.collect(&map_));
    EXPECT_TRUE(manager_.idle());
  }

  [[nodiscard]] double keyframeError(KeyframeId id) const {
    const Transform truth = testing::roomView(10.0 * kDegree * static_cast<double>(id));
    return (map_.keyframes().at(id).T_w_c.p - truth.p).norm();
  }
  static void expectSameMap(const Map& a, const Map& b) {
    EXPECT_EQ(a.epoch(), b.epoch());
    ASSERT_EQ(a.keyframes().size(), b.keyframes().size());
    for (const auto& [id, keyframe] : a.keyframes()) {
      EXPECT_EQ(keyframe.T_w_c.p, b.keyframes().at(id).T_w_c.p) << "keyframe " << id;
      EXPECT_EQ(keyframe.T_w_c.R, b.keyframes().at(id).T_w_c.R) << "keyframe " << id;
    }
    for (const auto& [id, marker] : a.markers()) {
      EXPECT_EQ(marker.T_w_m->p, b.find(id)->T_w_m->p) << "marker " << id;
    }
  }

  static constexpr double kClosing_deg = 330.0;
  std::mt19937 rng_{63};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_;
  MarkerOptions options_;
  LoopOptions loops_;
  RelocalizerOptions relocalization_;
  PoseOptimizer optimizer_{camera_.focalLength()};
  LocalMarkers local_;
  MarkerScreening screening_{options_, MarkerScreeningOptions{}};
  Counters counters_;
  Map map_;
  std::uint64_t sequence_ = 100;
  LoopClosureManager manager_{options_,   loops_, relocalization_, camera_,
                              optimizer_, local_, &screening_,     &counters_};
};

TEST_F(LoopClosureManagerTest, WithoutALoopInViewThereIsNothingToDo) {
  bendMap();
  const SeenFrame frame = look(318.0);
  EXPECT_FALSE(manager_.closeOrJoin(map_, 1.0, frame.tracked, frame.fitting).joins);
  EXPECT_TRUE(manager_.idle());
  manager_.work(kBudget);
  EXPECT_FALSE(manager_.isDone());
  EXPECT_FALSE(manager_.collect(&map_));
}

TEST_F(LoopClosureManagerTest, ALoopIsClosedOverSeveralFrames) {
  bendMap();
  const Map before = map_;
  const double drift = keyframeError(kLast);
  ASSERT_GT(drift, 0.2);
  const SeenFrame frame = look(kClosing_deg);
  EXPECT_FALSE(manager_.closeOrJoin(map_, 1.0, frame.tracked, frame.fitting).joins);
  EXPECT_FALSE(manager_.idle());
  int frames = 0;
  while (!manager_.isDone() && frames < kForever) {
    EXPECT_FALSE(manager_.collect(&map_)) << "not done yet";
    EXPECT_FALSE(meetLoop().joins) << "the one under way goes on";
    manager_.work(kBudget);
    ++frames;
  }
  EXPECT_GT(frames, 10);
  expectSameMap(map_, before);
  EXPECT_EQ(counters_.loop_closures, 0U);

  for (int i = 0; i < 60; ++i) screening_.record(5, false, i * testing::kFramePeriodNs);
  ASSERT_TRUE(screening_.suspectsMoved(map_));
  const auto T_new_old = manager_.collect(&map_);
  ASSERT_TRUE(T_new_old);
  EXPECT_TRUE(manager_.idle());
  const Transform corrected = *T_new_old * frame.tracked.solution.T_w_c;
  EXPECT_LT((corrected.p - testing::roomView(kClosing_deg * kDegree).p).norm(), 0.02)
      << "it takes the camera where it is";
  EXPECT_LT(keyframeError(kLast), 0.05 * drift);
  EXPECT_EQ(map_.keyframes().size(), before.keyframes().size() + 1);
  const Keyframe& closing = map_.keyframes().rbegin()->second;
  EXPECT_EQ(closing.sequence, frame.tracked.time.sequence);
  EXPECT_NE(closing.find(kLoopMarker), nullptr) << "it joins both ends";
  EXPECT_EQ(counters_.loop_closures, 1U);
  EXPECT_EQ(counters_.keyframes_added, 1U);
  EXPECT_EQ(counters_.loops_refused, 0U);
  EXPECT_FALSE(screening_.suspectsMoved(map_)) << "it may agree with the corrected map";
  EXPECT_FALSE(manager_.collect(&map_)) << "once is enough";
}

// A frame does what it is allowed to, and where that is too little, as much as it takes to be done
// in time.
TEST_F(LoopClosureManagerTest, AFrameDoesItsShareOfTheWork) {
  bendMap();
  const Map bent = map_;
  std::vector<int> frames;
  for (const double budget : {300.0, 60.0, 0.0}) {
    (void)meetLoop();
    frames.push_back(workToTheEnd(budget));
    EXPECT_TRUE(manager_.collect(&map_));
    map_ = bent;
  }
  EXPECT_GT(frames[0], 1);
  EXPECT_GT(frames[1], 4 * frames[0] - 4) << "a fifth of the work each";
  EXPECT_GT(frames[2], frames[1]);
  EXPECT_LE(frames[2], loops_.frames_to_close);
}

// Both ends agree as well as corners can tell.
TEST_F(LoopClosureManagerTest, EndsThatAgreeAreJoinedAsTheyAre) {
  SeenFrame frame = look(kClosing_deg);
  MarkerDetection blurred = *frame.markers.loop[0].detection;
  for (Eigen::Matrix2d& covariance : blurred.covariance) covariance *= 100.0;
  frame.markers.loop[0].detection = &blurred;
  const LoopJunction junction = manager_.closeOrJoin(map_, 1.0, frame.tracked, frame.fitting);
  EXPECT_TRUE(junction.joins);
  ASSERT_EQ(junction.joined.size(), 1U);
  EXPECT_EQ(junction.joined[0].id, kLoopMarker);
  EXPECT_TRUE(manager_.idle());
  EXPECT_EQ(counters_.loops_without_drift, 1U);
}

TEST_F(LoopClosureManagerTest, ARejectedLoopChangesNothing) {
  moveLoopMarker();
  const Map before = map_;
  meetAndReject();
  expectSameMap(map_, before);
  EXPECT_EQ(counters_.loops_refused, 1U);
  EXPECT_EQ(counters_.loop_closures, 0U);
  EXPECT_EQ(counters_.loops_without_drift, 0U);
}

TEST_F(LoopClosureManagerTest, AttemptsKeepTheirDistance) {
  moveLoopMarker();
  for (std::uint64_t attempt = 1; attempt <= 3; ++attempt) {
    meetAndReject();
    EXPECT_EQ(counters_.loops_refused, attempt);
    for (int i = 0; i < kFramesBetweenAttempts; ++i) {
      EXPECT_FALSE(meetLoop().joins);
      EXPECT_TRUE(manager_.idle()) << "frame " << i << " after attempt " << attempt;
    }
  }
}

// The screening hears of every frame in which the marker contradicts, attempt or not.
TEST_F(LoopClosureManagerTest, AMarkerWhoseLoopIsRejectedHasMovedInTheEnd) {
  moveLoopMarker();
  const MarkerScreeningOptions screening;
  meetAndReject();
  for (int i = 0; i < kFramesBetweenAttempts; ++i) (void)meetLoop();
  EXPECT_FALSE(screening_.suspectsMoved(map_)) << "too few frames";
  EXPECT_FALSE(meetLoop().joins);
  EXPECT_FALSE(manager_.idle());
  for (int i = kFramesBetweenAttempts; i < screening.moved_frames; ++i) (void)meetLoop();
  EXPECT_TRUE(screening_.suspectsMoved(map_)) << "also while a loop is tested";
}

// The ends agree as well as the map agrees with itself: when no correction improves on that, they
// are joined, and nothing has been refused.
TEST_F(LoopClosureManagerTest, WhatAgreesRoughlyIsJoinedWhereNoCorrectionHelps) {
  moveLoopMarker();
  constexpr double kRough = 1000.0;  // residual sigma
  meetAndReject(kRough);
  EXPECT_EQ(counters_.loops_refused, 0U);
  EXPECT_TRUE(meetLoop(kRough).joins);
  EXPECT_TRUE(manager_.idle());
  EXPECT_EQ(counters_.loops_without_drift, 1U);
}

// The map is moved as a whole while the loop is being solved: its correction is worth nothing.
TEST_F(LoopClosureManagerTest, ACorrectionOfAnotherMapIsNotApplied) {
  bendMap();
  (void)meetLoop();
  manager_.work(kBudget);
  map_.moveWorld({expSo3({0.0, 0.0, 0.3}), {1.0, 0.0, 0.0}});
  map_.beginEpoch();
  const Map before = map_;
  EXPECT_LT(workToTheEnd(kBudget), kForever);
  EXPECT_FALSE(manager_.collect(&map_));
  expectSameMap(map_, before);
  EXPECT_EQ(counters_.loop_closures + counters_.loops_refused + counters_.keyframes_added, 0U);
  EXPECT_TRUE(manager_.idle());
  EXPECT_FALSE(meetLoop().joins);
  EXPECT_FALSE(manager_.idle()) << "nothing was rejected: it is tried again at once";
}

// The map goes on growing, and loses a keyframe and a marker, while the loop is being solved.
TEST_F(LoopClosureManagerTest, WhatTheMapBecameMeanwhileIsKept) {
  bendMap();
  const SeenFrame frame = look(kClosing_deg);
  (void)manager_.closeOrJoin(map_, 1.0, frame.tracked, frame.fitting);
  manager_.work(1.0);  // its copy of the map is not yet complete
  EXPECT_FALSE(manager_.isDone());
  constexpr KeyframeId kLetGo = 30;
  constexpr int kQuarantined = 12;
  map_.removeKeyframe(kLetGo);
  map_.quarantine(kQuarantined);
  const Transform T_w_late = frame.tracked.solution.T_w_c.retract(Vector6d::Constant(0.05));
  const KeyframeId late = map_.addKeyframe({-1, 0, 0, T_w_late, {}});
  EXPECT_LT(workToTheEnd(kBudget), kForever);
  const auto T_new_old = manager_.collect(&map_);
  ASSERT_TRUE(T_new_old);
  EXPECT_LT((map_.keyframes().at(late).T_w_c.p - (*T_new_old * T_w_late).p).norm(), 1e-9);
  EXPECT_FALSE(map_.keyframes().contains(kLetGo));
  EXPECT_FALSE(map_.find(kQuarantined)->T_w_m);
  EXPECT_LT(keyframeError(kLast), 0.02);
}

// A marker that was seen a few times, badly, says nothing of a loop: the next keyframe takes it
// along.
TEST_F(LoopClosureManagerTest, MarkersHardlySeenCloseNoLoop) {
  Transform T_w_m = *map_.find(kLoopMarker)->T_w_m;
  T_w_m.p.z() += 0.01;
  map_.place(kLoopMarker, T_w_m);
  const SeenFrame frame = look(kClosing_deg);
  ASSERT_EQ(frame.markers.loop.size(), 1U);
  ASSERT_LT(static_cast<int>(map_.viewsOf(kLoopMarker).size()), loops_.sure_views);
  loops_.region_keyframes = 10;  // for a large map
  const LoopJunction junction = manager_.closeOrJoin(map_, 1.0, frame.tracked, frame.fitting);
  EXPECT_TRUE(junction.joins);
  ASSERT_EQ(junction.joined.size(), 1U);
  EXPECT_EQ(junction.joined[0].id, kLoopMarker);
  EXPECT_TRUE(manager_.idle());
  loops_.sure_views = 1;
  EXPECT_FALSE(manager_.closeOrJoin(map_, 1.0, frame.tracked, frame.fitting).joins);
  EXPECT_FALSE(manager_.idle()) << "it is a witness now";
}

// Where a closure would take long, ends that differ by no more than the map may have drifted are
// joined, and the map is relaxed around them.
TEST_F(LoopClosureManagerTest, InALargeMapSmallDriftIsJoined) {
  Transform T_w_m = *map_.find(kLoopMarker)->T_w_m;
  T_w_m.p.z() += 0.01;
  map_.place(kLoopMarker, T_w_m);
  loops_.region_keyframes = 10;
  loops_.sure_views = 1;
  const Matrix6d drift = Matrix6d::Identity() * 0.02 * 0.02;
  map_.setWorldCovariance(kLoopMarker, drift);
  const LoopJunction junction = meetLoop();
  EXPECT_TRUE(junction.joins);
  EXPECT_EQ(junction.joined.size(), 1U);
  EXPECT_FALSE(manager_.idle());
  EXPECT_LT(workToTheEnd(kBudget), kForever);
  EXPECT_TRUE(manager_.collect(&map_));
}

// What was corrected in part is optimized as a whole when there is time.
TEST_F(LoopClosureManagerTest, InIdleTimeTheWholeMapIsRelaxed) {
  Transform T_w_m = *map_.find(kLoopMarker)->T_w_m;
  T_w_m.p.z() += 0.01;
  map_.place(kLoopMarker, T_w_m);
  map_.setWorldCovariance(kLoopMarker, Matrix6d::Identity() * 0.02 * 0.02);
  loops_.region_keyframes = 10;
  loops_.sure_views = 1;
  loops_.frames_before_relaxing = 3;
  const auto idleFrames = [&](int frames) {
    for (int i = 0; i < frames; ++i) manager_.relaxInIdleTime(map_, true);
  };
  idleFrames(10);
  EXPECT_TRUE(manager_.idle()) << "nothing was corrected";
  const SeenFrame frame = look(kClosing_deg);
  ASSERT_TRUE(manager_.closeOrJoin(map_, 1.0, frame.tracked, frame.fitting).joins);
  EXPECT_LT(workToTheEnd(kBudget), kForever);
  ASSERT_TRUE(manager_.collect(&map_));
  const std::uint64_t closures = counters_.loop_closures;
  idleFrames(2);
  manager_.relaxInIdleTime(map_, false);
  idleFrames(2);
  EXPECT_TRUE(manager_.idle()) << "not so many in a row";
  idleFrames(1);
  EXPECT_FALSE(manager_.idle());
  Map whole = map_;
  (void)optimizeGlobally(&whole, options_, loops_.optimization);
  EXPECT_LT(workToTheEnd(kBudget), kForever);
  EXPECT_TRUE(manager_.collect(&map_));
  for (const auto& [id, keyframe] : whole.keyframes()) {
    EXPECT_LT((map_.keyframes().at(id).T_w_c.p - keyframe.T_w_c.p).norm(), 1e-9);
  }
  EXPECT_EQ(counters_.loop_closures, closures) << "it is none";
  idleFrames(10);
  EXPECT_TRUE(manager_.idle()) << "once is enough";
}

// While a large loop is being closed, the camera may be lost, and found again where the map began,
// which the closure moves least.
TEST_F(LoopClosureManagerTest, TheCameraMayBeElsewhereByThen) {
  bendMap();
  (void)meetLoop();
  manager_.work(kBudget);
  manager_.notePlaceLost();
  manager_.work(kBudget);
  const Keyframe& beginning = map_.keyframes().at(2);
  local_.update(map_, beginning.detections, beginning.T_w_c, 2.0, KeyframeOptions{});
  const KeyframeId reference = local_.reference().value();
  const Map before = map_;
  EXPECT_LT(workToTheEnd(kBudget), kForever);
  const auto T_new_old = manager_.collect(&map_);
  ASSERT_TRUE(T_new_old);
  const auto movedTo = [&](KeyframeId id) {
    return (*T_new_old * before.keyframes().at(id).T_w_c.p - map_.keyframes().at(id).T_w_c.p)
        .norm();
  };
  EXPECT_LT(movedTo(reference), 1e-9);
  EXPECT_GT(movedTo(kLast), 0.1);
}

// A marker of the neighbourhood has long disagreed. That may be a loop that went unnoticed, which
// is tried first; it was none, so the marker moved.
TEST_F(LoopClosureManagerTest, AMarkerMovedWhenNoLoopExplainsIt) {
  constexpr int kMoved = 20;
  moveMarker(kMoved, {0.05, 0.1, 0.1});
  const auto confirm = [&] {
    const SeenFrame frame = look(316.0, kMoved);
    EXPECT_EQ(frame.markers.eligible.size(), 3U);
    return manager_.confirmMoved(map_, frame.tracked, frame.fitting);
  };
  EXPECT_FALSE(confirm()) << "nobody suspects anything";
  EXPECT_TRUE(manager_.idle());
  for (int i = 0; i < 60; ++i) screening_.record(kMoved, false, i * testing::kFramePeriodNs);
  EXPECT_FALSE(confirm());
  EXPECT_FALSE(manager_.idle()) << "a loop is tried first";
  EXPECT_FALSE(confirm()) << "its end will tell";
  EXPECT_LT(workToTheEnd(kBudget), kForever);
  EXPECT_FALSE(manager_.collect(&map_));
  EXPECT_TRUE(confirm());
  EXPECT_EQ(counters_.loops_refused, 0U) << "nobody met a loop";
}

}  // namespace
}  // namespace waymark::slam
