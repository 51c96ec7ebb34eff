#include "slam/final_map.h"

#include <algorithm>
#include <optional>
#include <random>
#include <set>
#include <utility>

#include <gtest/gtest.h>

#include "slam/final_trajectory.h"
#include "slam/slam.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

constexpr int kFrames = 1000;

// Marker 1 is in every frame, marker 2 in a few; frames without a pose are those of `lost`.
std::vector<LiveFrame> walk(const std::set<int>& with_marker_2, const std::set<int>& lost) {
  std::vector<LiveFrame> frames(kFrames);
  for (int i = 0; i < kFrames; ++i) {
    LiveFrame& frame = frames[static_cast<std::size_t>(i)];
    frame.detections.emplace_back().id = 1;
    if (with_marker_2.contains(i)) frame.detections.emplace_back().id = 2;
    if (lost.contains(i)) continue;
    frame.pose.emplace();
    frame.pose->T_w_c.p.x() = i;
    frame.pose->twist = Vector6d::Constant(i);
  }
  return frames;
}

std::set<int> numbersOf(const std::vector<RecordedFrame>& frames) {
  std::set<int> numbers;
  for (const RecordedFrame& frame : frames) numbers.insert(static_cast<int>(frame.sequence));
  return numbers;
}

TEST(SpreadFrames, AreEvenlySpread) {
  const auto frames = walk({}, {});
  EXPECT_EQ(numbersOf(spreadFrames(frames, {.frames = 4, .views_per_marker = 0})),
            (std::set<int>{0, 250, 500, 750}));
  EXPECT_EQ(spreadFrames(frames, {.frames = 2 * kFrames, .views_per_marker = 0}).size(),
            std::size_t{kFrames});
  EXPECT_TRUE(spreadFrames(frames, {.frames = 0, .views_per_marker = 0}).empty());
  EXPECT_EQ(spreadFrames(frames, {}).size(), FinalMapOptions{}.frames)
      << "marker 1 has views enough";
}

TEST(SpreadFrames, AMarkerThatIsSeldomSeenCountsEveryView) {
  const auto frames = walk({601, 602, 603, 604, 605}, {});
  EXPECT_EQ(numbersOf(spreadFrames(frames, {.frames = 4, .views_per_marker = 5})),
            (std::set<int>{0, 200, 250, 400, 500, 600, 601, 602, 603, 604, 605, 750, 800}));
  EXPECT_EQ(numbersOf(spreadFrames(frames, {.frames = 4, .views_per_marker = 2})),
            (std::set<int>{0, 250, 500, 601, 603, 750}))
      << "spread over its frames, too";
}

TEST(SpreadFrames, ALostFrameStartsFromItsNeighbour) {
  const auto live = walk({}, {0, 1, 2, 500, 501});
  const auto frames = spreadFrames(live, {.frames = kFrames, .views_per_marker = 0});
  ASSERT_EQ(frames.size(), std::size_t{kFrames});
  EXPECT_EQ(frames[0].T_w_c.p.x(), 3.0) << "in front of the first pose";
  EXPECT_EQ(frames[501].T_w_c.p.x(), 499.0);
  EXPECT_TRUE(frames[501].twist.isZero()) << "how fast it was is not known";
  EXPECT_EQ(frames[502].T_w_c.p.x(), 502.0);
  EXPECT_EQ(frames[502].twist[0], 502.5) << "as this frame and the next one tell";
  EXPECT_EQ(frames[499].twist[0], 499.0) << "nobody tells how it went on";
  EXPECT_EQ(frames[502].detections.data(), live[502].detections.data());
}

TEST(SpreadFrames, WithoutAnyPoseThereIsNothingToStartFrom) {
  std::set<int> all;
  for (int i = 0; i < kFrames; ++i) all.insert(i);
  EXPECT_TRUE(spreadFrames(walk({}, all), {.frames = kFrames}).empty());
  EXPECT_TRUE(spreadFrames({}, {}).empty());
}

bool same(const Transform& a, const Transform& b) { return a.p == b.p && a.R == b.R; }

// Bit for bit.
void expectSameMap(const Map& a, const Map& b) {
  ASSERT_EQ(a.keyframes().size(), b.keyframes().size());
  for (const auto& [id, keyframe] : a.keyframes()) {
    ASSERT_TRUE(b.keyframes().contains(id));
    const Keyframe& other = b.keyframes().at(id);
    EXPECT_TRUE(same(keyframe.T_w_c, other.T_w_c)) << id;
    EXPECT_EQ(keyframe.detections.size(), other.detections.size()) << id;
  }
  ASSERT_EQ(a.markers().size(), b.markers().size());
  for (const auto& [id, marker] : a.markers()) {
    const MapMarker* const other = b.find(id);
    ASSERT_TRUE(other != nullptr && marker.T_w_m.has_value() == other->T_w_m.has_value()) << id;
    if (!marker.T_w_m) continue;
    EXPECT_TRUE(same(*marker.T_w_m, *other->T_w_m)) << id;
  }
}

// A corridor: markers half a metre apart along a wall, of which a view shows three or four.
class FinalMapTest : public ::testing::Test {
 protected:
  static constexpr double kSize_m = 0.2;
  static constexpr int kMarkers = 12;

  FinalMapTest() {
    options_.markers.size_m = kSize_m;
    std::uniform_real_distribution<double> u(-1.0, 1.0);
    for (int i = 0; i < kMarkers; ++i) {
      const Eigen::Vector3d centre(0.5 * i, 2.0, 0.2 * u(rng_));
      markers_.push_back({i, testing::markerFacing(
                                 centre, centre + Eigen::Vector3d(0.8 * u(rng_), -1.0, u(rng_)))});
    }
  }

  [[nodiscard]] static Transform viewAt(double x_m) {
    return testing::lookAt({x_m, 0.5 + 0.1 * std::sin(5.0 * x_m), 0.1 * std::cos(3.0 * x_m)},
                           {x_m + 0.05 * std::sin(7.0 * x_m), 2.0, 0.0});
  }
  // From one end of the corridor towards the other, two centimetres a frame.
  [[nodiscard]] static std::vector<Transform> walkAlong(int frames) {
    std::vector<Transform> views;
    for (int i = 0; i < frames; ++i) views.push_back(viewAt(0.5 + 0.02 * i));
    return views;
  }
  [[nodiscard]] static Dictionary dictionary() { return *Dictionary::byName("APRILTAG_36h11"); }

  [[nodiscard]] std::vector<MarkerDetection> seenFrom(const Transform& T_w_c) {
    return testing::observeAll(camera_, T_w_c, markers_, kSize_m, sigma_px_, &rng_);
  }
  // Feeds what the views show, and records it.
  std::vector<LiveFrame> watch(const std::vector<Transform>& views, Slam* slam) {
    std::vector<LiveFrame> frames;
    for (const Transform& T_w_c : views) add(seenFrom(T_w_c), slam, &frames);
    return frames;
  }
  static void add(std::vector<MarkerDetection> detections, Slam* slam,
                  std::vector<LiveFrame>* frames) {
    const auto number = frames->size();
    const auto time_ns = static_cast<std::int64_t>(number) * testing::kFramePeriodNs;
    auto pose = slam->process({.time = {number, time_ns}, .detections = detections}).pose;
    frames->push_back({time_ns, std::move(pose), std::move(detections)});
  }
  static void feed(const std::vector<LiveFrame>& frames, Slam* slam) {
    std::vector<LiveFrame> nobodys;
    for (const LiveFrame& frame : frames) add(frame.detections, slam, &nobodys);
  }

  // Mean distance of the markers from where they hang, in the world of the first view.
  [[nodiscard]] double errorOf(const Map& map, const Transform& T_w_first) const {
    double sum = 0.0;
    int count = 0;
    for (const testing::SyntheticMarker& truth : markers_) {
      const MapMarker* const marker = map.findPosed(truth.id);
      if (marker == nullptr) continue;
      sum += (marker->T_w_m->p - T_w_first.inverse() * truth.T_w_m.p).norm();
      ++count;
    }
    return sum / count;
  }
  [[nodiscard]] static std::optional<KeyframeId> keyframeOf(std::uint64_t sequence,
                                                            const Map& map) {
    for (const auto& [id, keyframe] : map.keyframes()) {
      if (keyframe.sequence == sequence) return id;
    }
    return std::nullopt;
  }

  std::mt19937 rng_{17};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_;
  double sigma_px_ = 0.2;
  Options options_;
};

TEST_F(FinalMapTest, MoreViewsMakeABetterMap) {
  const std::vector<Transform> views = walkAlong(220);
  Slam slam(camera_, dictionary(), options_);
  auto frames = watch(views, &slam);
  ASSERT_TRUE(frames.front().pose) << "the world is the first view";
  const std::size_t keyframes = slam.map().keyframes().size();
  Slam with_keyframes_only(camera_, dictionary(), options_);
  feed(frames, &with_keyframes_only);
  with_keyframes_only.optimizeGlobally();

  makeFinalMap(frames, {}, &slam);
  EXPECT_EQ(slam.map().keyframes().size(), views.size()) << "fewer frames than are wanted";
  EXPECT_GT(slam.map().keyframes().size(), keyframes);
  EXPECT_EQ(slam.map().markers().size(), std::size_t{kMarkers});
  EXPECT_LT(errorOf(slam.map(), views[0]), errorOf(with_keyframes_only.map(), views[0]));
}

TEST_F(FinalMapTest, AMarkerSeenForAMomentGetsAllItsViews) {
  Slam slam(camera_, dictionary(), options_);
  std::vector<LiveFrame> frames;
  std::size_t seen = 0;
  for (const Transform& T_w_c : walkAlong(150)) {
    auto detections = seenFrom(T_w_c);
    const bool uncovered = frames.size() >= 40 && frames.size() < 52;
    std::erase_if(detections, [&](const auto& d) { return d.id == 3 && !uncovered; });
    seen += std::ranges::count(detections, 3, &MarkerDetection::id) > 0 ? 1 : 0;
    add(std::move(detections), &slam, &frames);
  }
  ASSERT_EQ(seen, 12U);
  ASSERT_LT(slam.map().viewsOf(3).size(), seen);
  const std::size_t keyframes = slam.map().keyframes().size();
  makeFinalMap(frames, {.frames = 5, .views_per_marker = 12}, &slam);
  EXPECT_EQ(slam.map().viewsOf(3).size(), seen);
  EXPECT_LT(slam.map().keyframes().size(), frames.size()) << "the others need not have all theirs";
  EXPECT_GT(slam.map().keyframes().size(), keyframes);
}

// The two at the far end come before those that connect them, and the farthest first: it takes two
// passes to place it.
TEST_F(FinalMapTest, PhotographsFindTheirPlaceInTheEnd) {
  options_.treatAsUnorderedImages();
  Slam slam(camera_, dictionary(), options_);
  const std::vector<double> along_m = {0.5, 0.8, 4.4, 3.4, 1.1, 1.4, 1.9, 2.4};
  std::vector<Transform> views;
  for (const double x : along_m) views.push_back(viewAt(x));
  auto frames = watch(views, &slam);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    ASSERT_EQ(frames[i].pose.has_value(), i != 2 && i != 3) << i;
  }
  // Nothing but the map's own keyframes, so that nothing else places them.
  const FinalMapOptions no_more_views{.frames = 0, .views_per_marker = 0};
  FinalMapOptions unordered = no_more_views;
  unordered.unordered_images = true;
  Slam in_order(camera_, dictionary(), options_);
  feed(frames, &in_order);
  makeFinalMap(frames, no_more_views, &in_order);
  EXPECT_FALSE(keyframeOf(2, in_order.map())) << "a sequence is left as it came";
  EXPECT_FALSE(keyframeOf(3, in_order.map()));

  const std::uint64_t before = slam.counters().frames;
  makeFinalMap(frames, unordered, &slam);
  EXPECT_EQ(slam.counters().frames, before + 3) << "both, and the farthest once more";
  EXPECT_TRUE(keyframeOf(2, slam.map()));
  EXPECT_TRUE(keyframeOf(3, slam.map()));
  const auto poses = localizeAll(frames, {.unordered_images = true}, slam);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    ASSERT_TRUE(poses[i].pose) << i;
    EXPECT_LT((poses[i].pose->T_w_c.p - views[0].inverse() * views[i].p).norm(), 0.05) << i;
  }
}

TEST_F(FinalMapTest, WhatFitsNowhereIsGivenUp) {
  options_.treatAsUnorderedImages();
  Slam slam(camera_, dictionary(), options_);
  auto frames = watch({viewAt(0.5), viewAt(0.8), viewAt(5.0)}, &slam);
  const std::uint64_t before = slam.counters().frames;
  tryAgain(frames, &slam);
  EXPECT_EQ(slam.counters().frames, before + 1) << "one pass";
  EXPECT_FALSE(localizeAll(frames, {.unordered_images = true}, slam)[2].pose);
}

// As the daemon saves: it keeps no frames.
TEST_F(FinalMapTest, WithoutFramesItIsTheGlobalOptimization) {
  Slam slam(camera_, dictionary(), options_);
  const auto frames = watch(walkAlong(80), &slam);
  Slam other(camera_, dictionary(), options_);
  feed(frames, &other);
  other.finish();
  const Map live = other.map();
  other.optimizeGlobally();
  makeFinalMap({}, {}, &slam);
  expectSameMap(slam.map(), other.map());
  EXPECT_FALSE(same(*live.find(4)->T_w_m, *slam.map().find(4)->T_w_m)) << "it did something";
}

TEST_F(FinalMapTest, NotWantedTheMapIsWhatItWasLive) {
  Slam slam(camera_, dictionary(), options_);
  auto frames = watch(walkAlong(80), &slam);
  Slam other(camera_, dictionary(), options_);
  feed(frames, &other);
  other.finish();
  makeFinalMap(frames, {.optimize = false}, &slam);
  expectSameMap(slam.map(), other.map());
}

TEST_F(FinalMapTest, AMapThatIsOnlyLocalizedInStaysAsItIs) {
  Slam first(camera_, dictionary(), options_);
  (void)watch(walkAlong(80), &first);
  const Map map = first.map();
  options_.mapping = false;
  Slam slam(camera_, dictionary(), options_, map);
  auto frames = watch(walkAlong(40), &slam);
  ASSERT_TRUE(frames.back().pose);
  makeFinalMap(frames, {}, &slam);
  expectSameMap(slam.map(), map);
}

TEST_F(FinalMapTest, TheFramesCornersFollowTheLens) {
  const CameraModel truth = camera_;
  Calibration stale = camera_.calibration();
  stale.fx += 6.0;
  stale.fy += 6.0;
  Slam slam(CameraModel(stale), dictionary(), options_);
  std::vector<LiveFrame> frames;
  for (const Transform& T_w_c : walkAlong(100)) {
    auto detections = seenFrom(T_w_c);
    for (MarkerDetection& d : detections) ASSERT_TRUE(undistortCorners(slam.camera(), &d));
    add(std::move(detections), &slam, &frames);
  }
  makeFinalMap(frames, {.refine_intrinsics = true}, &slam);
  const Calibration& found = slam.camera().calibration();
  EXPECT_LT(std::abs(found.fx - truth.calibration().fx), 3.0);
  EXPECT_NE(found.fx, stale.fx);
  for (const LiveFrame& frame : frames) {
    ASSERT_FALSE(frame.detections.empty());
    for (const MarkerDetection& seen : frame.detections) {
      const auto pixel = slam.camera().project(seen.normalized[1].homogeneous());
      ASSERT_TRUE(pixel);
      EXPECT_LT((*pixel - seen.pixels[1]).norm(), 1e-6);
    }
  }
}

TEST_F(FinalMapTest, EveryFrameIsLocalizedAgain) {
  const std::vector<Transform> views = walkAlong(120);
  Slam slam(camera_, dictionary(), options_);
  auto frames = watch(views, &slam);
  ASSERT_TRUE(frames.front().pose);
  // As if the start had been missed, and something in the middle; frame 90 shows nothing.
  for (const std::size_t i : {0, 1, 2, 60, 61}) frames[i].pose.reset();
  frames[90].detections.clear();
  const auto poses = localizeAll(frames, {}, slam);
  ASSERT_EQ(poses.size(), frames.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    ASSERT_EQ(poses[i].pose.has_value(), i != 90) << i;
    EXPECT_EQ(poses[i].reason, i == 90 ? NoPoseReason::kNoMarker : NoPoseReason::kNone);
    if (i == 90) continue;
    EXPECT_LT((poses[i].pose->T_w_c.p - views[0].inverse() * views[i].p).norm(), 0.05) << i;
  }
  for (LiveFrame& frame : frames) frame.pose.reset();
  for (const auto& frame : localizeAll(frames, {}, slam)) {
    EXPECT_FALSE(frame.pose) << "nothing to start from";
  }
}

}  // namespace
}  // namespace waymark::slam
