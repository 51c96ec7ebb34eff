#include "slam/mapping/recorded_frames.h"

#include <algorithm>
#include <deque>
#include <random>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "slam/geometry/twist.h"
#include "slam/testing/rolling_views.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.15;
constexpr KeyframeId kNoneOld = -1;

// A wall of twelve markers, of which the map knows ten: 10 has been seen, but has no pose; 11 is
// unknown.
class RecordedFramesTest : public ::testing::Test {
 protected:
  RecordedFramesTest() {
    for (int id = 0; id < 11; ++id) {
      (void)map_.addMarker(id, kSize);
      if (id != 10) map_.place(id, markers_[static_cast<std::size_t>(id)].T_w_m);
    }
  }

  // Somewhere along the wall, in sight of all of it.
  [[nodiscard]] static Transform viewAt(int i) {
    return testing::lookAt({0.1 * i - 0.4, 0.05 * i, 0.1}, {0.0, 3.0, 0.0});
  }
  std::vector<MarkerDetection> seenFrom(const Transform& T_w_c) {
    return testing::observeAll(camera_, T_w_c, markers_, kSize, 0.05, &rng_);
  }
  // A recorded frame with a first guess a little off; its detections stay in this fixture.
  RecordedFrame frameAt(int i, std::vector<MarkerDetection> detections) {
    detections_.push_back(std::move(detections));
    return {static_cast<std::uint64_t>(i), timeOf(i), detections_.back(),
            testing::disturbed(viewAt(i), 0.02, &rng_)};
  }
  RecordedFrame frameAt(int i) { return frameAt(i, seenFrom(viewAt(i))); }
  [[nodiscard]] static std::int64_t timeOf(int i) { return 1000 + i * testing::kFramePeriodNs; }

  KeyframeId addKeyframe(int i, const std::set<int>& of) {
    Keyframe keyframe;
    keyframe.monotonic_ns = timeOf(i);
    keyframe.T_w_c = viewAt(i);
    for (const MarkerDetection& detection : seenFrom(viewAt(i))) {
      if (of.contains(detection.id)) keyframe.detections.push_back(detection);
    }
    return map_.addKeyframe(keyframe);
  }
  [[nodiscard]] static std::vector<int> idsOf(std::span<const MarkerDetection> detections) {
    std::vector<int> ids;
    for (const MarkerDetection& detection : detections) ids.push_back(detection.id);
    return ids;
  }

  std::mt19937 rng_{4};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = testing::markerWall(3, 4, 0.4, &rng_);
  MarkerOptions options_{.size_m = kSize, .ignored = {{2, 2}}};
  MarkerScreening screening_{options_, {}};
  RollingShutterEstimator global_shutter_{{}, options_};
  Tracker tracker_{camera_.focalLength(), {}};
  RecordedFrameLocator locator_{screening_, camera_, global_shutter_, tracker_};
  Map map_;
  std::deque<std::vector<MarkerDetection>> detections_;
};

TEST_F(RecordedFramesTest, LocatesAFrameNearItsGuess) {
  const RecordedFrame frame = frameAt(3);
  const auto located = locator_.locate(map_, frame);
  ASSERT_TRUE(located);
  EXPECT_LT((located->solution.T_w_c.p - viewAt(3).p).norm(), 0.005);
  EXPECT_GT((frame.T_w_c.p - viewAt(3).p).norm(), 0.01);
  EXPECT_EQ(located->known.size(), 9U) << "all with a pose, but the ignored one";
  EXPECT_EQ(located->solution.inliers, 9);
  EXPECT_EQ(located->known[0].detection, &located->detections[0]);
}

TEST_F(RecordedFramesTest, AWrongGuessDoesNotMatter) {
  RecordedFrame frame = frameAt(3);
  frame.T_w_c = testing::lookAt({0.5, 6.0, 1.0}, {0.0, 3.0, 0.0});  // from behind the wall
  const auto located = locator_.locate(map_, frame);
  ASSERT_TRUE(located);
  EXPECT_LT((located->solution.T_w_c.p - viewAt(3).p).norm(), 0.005);
}

TEST_F(RecordedFramesTest, WithTooLittleToGoByThereIsNoPlace) {
  EXPECT_FALSE(locator_.locate(map_, frameAt(3, {})));
  const auto onlyOf = [this](const std::set<int>& ids) {
    auto detections = seenFrom(viewAt(3));
    std::erase_if(detections, [&](const auto& d) { return !ids.contains(d.id); });
    EXPECT_EQ(detections.size(), ids.size());
    return frameAt(3, detections);
  };
  EXPECT_FALSE(locator_.locate(map_, onlyOf({10, 11}))) << "none has a pose";
  EXPECT_FALSE(locator_.locate(map_, onlyOf({2}))) << "ignored";
  EXPECT_TRUE(locator_.locate(map_, onlyOf({4, 5, 6})));
  EXPECT_FALSE(locator_.locate(Map{}, frameAt(3)));
}

TEST_F(RecordedFramesTest, MarkersThatCannotBeTrustedAreLeftOut) {
  map_.ban(4);
  auto detections = seenFrom(viewAt(3));
  detections.push_back(*std::ranges::find(detections, 7, &MarkerDetection::id));
  const auto located = locator_.locate(map_, frameAt(3, detections));
  ASSERT_TRUE(located);
  EXPECT_EQ(idsOf(located->detections), (std::vector<int>{0, 1, 3, 5, 6, 8, 9, 10, 11}));
}

TEST_F(RecordedFramesTest, ARollingShutterIsTakenIntoAccount) {
  constexpr double kReadout_s = 0.02;
  Twist twist;
  twist << 0.2, 0.1, -0.1, 0.3, 0.8, -0.2;
  std::vector<MarkerDetection> skewed;
  for (const auto& marker : markers_) {
    const auto seen =
        testing::observeRolling(camera_, viewAt(3), twist, marker, kSize, kReadout_s, 0.05, &rng_);
    if (seen) skewed.push_back(*seen);
  }
  RecordedFrame frame = frameAt(3, skewed);
  frame.twist = twist;
  const RollingShutterEstimator known({.readout_s = kReadout_s}, options_);
  const RecordedFrameLocator rolling(screening_, camera_, known, tracker_);
  const auto located = rolling.locate(map_, frame);
  ASSERT_TRUE(located);
  EXPECT_LT((located->solution.T_w_c.p - viewAt(3).p).norm(), 0.005);
  const auto as_global = locator_.locate(map_, frame);
  EXPECT_TRUE(!as_global || as_global->solution.rms_px > 2.0 * located->solution.rms_px);
}

TEST_F(RecordedFramesTest, AFrameThatIsNoKeyframeBecomesOne) {
  (void)addKeyframe(0, {0, 1, 3});
  RecordedFrame frame = frameAt(3);
  frame.twist = Vector6d::Constant(0.01);
  // One that does not fit: it has moved since.
  Transform T_w_5 = *map_.find(5)->T_w_m;
  T_w_5.p.z() += 0.2;
  map_.place(5, T_w_5);
  locator_.densify({&frame, 1}, kNoneOld, &map_);
  ASSERT_EQ(map_.keyframes().size(), 2U);
  const Keyframe& added = map_.keyframes().rbegin()->second;
  EXPECT_EQ(added.sequence, 3U);
  EXPECT_EQ(added.monotonic_ns, timeOf(3));
  EXPECT_EQ(added.twist, frame.twist);
  EXPECT_LT((added.T_w_c.p - viewAt(3).p).norm(), 0.005);
  EXPECT_EQ(idsOf(added.detections), (std::vector<int>{0, 1, 3, 4, 6, 7, 8, 9, 10}))
      << "those that fit, and the one that has no pose yet; not the one nobody knows";
  EXPECT_EQ(map_.viewsOf(10).size(), 1U);
  EXPECT_EQ(map_.find(11), nullptr);
}

TEST_F(RecordedFramesTest, AKeyframeGetsTheMarkersThatFitByNow) {
  const KeyframeId first = addKeyframe(0, {0, 1, 3});
  const KeyframeId second = addKeyframe(3, {0, 1, 3});
  const Map before = map_;
  const std::vector<RecordedFrame> frames = {frameAt(3)};
  locator_.densify(frames, kNoneOld, &map_);
  EXPECT_EQ(map_.keyframes().size(), 2U);
  const Keyframe& was = before.keyframes().at(second);
  const Keyframe& is = map_.keyframes().at(second);
  EXPECT_EQ(idsOf(is.detections), (std::vector<int>{0, 1, 3, 4, 5, 6, 7, 8, 9, 10}));
  EXPECT_EQ(is.find(1)->pixels[0], was.find(1)->pixels[0]) << "what it has stays";
  EXPECT_EQ(is.find(4)->pixels[0],
            std::ranges::find(detections_[0], 4, &MarkerDetection::id)->pixels[0]);
  EXPECT_EQ(is.T_w_c.p, was.T_w_c.p) << "as does its pose";
  EXPECT_EQ(idsOf(map_.keyframes().at(first).detections), (std::vector<int>{0, 1, 3}));
  locator_.densify(frames, kNoneOld, &map_);
  EXPECT_EQ(map_.keyframes().at(second).detections.size(), 10U) << "once is enough";
}

// Another run's clock may have shown the same time.
TEST_F(RecordedFramesTest, KeyframesOfAnotherRunAreNotTheSameFrame) {
  const KeyframeId old = addKeyframe(3, {0, 1, 3});
  const std::vector<RecordedFrame> frames = {frameAt(3)};
  locator_.densify(frames, old, &map_);
  EXPECT_EQ(map_.keyframes().size(), 2U);
  EXPECT_EQ(idsOf(map_.keyframes().at(old).detections), (std::vector<int>{0, 1, 3}));
}

TEST_F(RecordedFramesTest, FramesWithoutAPlaceAreLeftOut) {
  (void)addKeyframe(0, {0, 1, 3});
  const std::vector<RecordedFrame> frames = {frameAt(1, {}), frameAt(2), frameAt(3, {})};
  locator_.densify(frames, kNoneOld, &map_);
  ASSERT_EQ(map_.keyframes().size(), 2U);
  EXPECT_EQ(map_.keyframes().rbegin()->second.sequence, 2U);
}

}  // namespace
}  // namespace waymark::slam
