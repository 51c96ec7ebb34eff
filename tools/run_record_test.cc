#include "tools/run_record.h"

#include <cmath>
#include <set>

#include <gtest/gtest.h>

namespace waymark::tools {
namespace {

constexpr std::int64_t kPeriod_ns = 40'000'000;

// Ten frames with a marker each; those of `lost` have no pose.
RunRecord walk(const std::set<int>& lost) {
  RunRecord record;
  for (int i = 0; i < 10; ++i) {
    std::vector<slam::MarkerDetection> detections(1);
    detections[0].id = i;
    slam::FrameResult result;
    result.detections = detections;
    if (!lost.contains(i)) {
      result.pose.emplace();
      result.pose->source = slam::PoseSource::kMarkers;
      result.pose->T_w_c.p.x() = i;
    }
    record.add(i * kPeriod_ns, result, {}, slam::LensState::kGiven);
  }
  return record;
}

TEST(RunRecord, KeepsWhatEachFrameWasLive) {
  RunRecord record = walk({0, 7});
  EXPECT_EQ(record.frames(), 10U);
  EXPECT_EQ(record.localized(), 8U);
  EXPECT_EQ(record.localizedPercent(), 80.0);
  const auto frames = record.liveFrames();
  ASSERT_EQ(frames.size(), 10U);
  EXPECT_FALSE(frames[7].pose);
  EXPECT_EQ(frames[7].monotonic_ns, 7 * kPeriod_ns);
  EXPECT_EQ(frames[7].detections.at(0).id, 7) << "the result's own are gone by now";
  EXPECT_EQ(frames[8].pose->T_w_c.p.x(), 8.0);
  EXPECT_EQ(record.recordedFrames().at(7).detections.at(0).id, 7);
}

TEST(RunRecord, EveryFrameIsAmongThePoses) {
  RunRecord record = walk({0, 7});
  slam::FrameResult lost;
  lost.state = slam::TrackingState::kRelocalizing;
  lost.reason = slam::NoPoseReason::kNoMarker;
  record.add(10 * kPeriod_ns, lost, {}, slam::LensState::kGiven);
  const auto poses = record.livePoses();
  ASSERT_EQ(poses.size(), 11U);
  EXPECT_EQ(poses[8].frame, 8U);
  EXPECT_EQ(poses[8].time_ns, 8 * kPeriod_ns);
  EXPECT_EQ(poses[8].pose->T_w_c.p.x(), 8.0);
  EXPECT_FALSE(poses[10].pose);
  EXPECT_EQ(poses[10].status, io::FrameStatus::kRelocalizing);
  EXPECT_EQ(poses[10].reason, "no marker in view");
  lost.state = slam::TrackingState::kLost;
  lost.reason = slam::NoPoseReason::kCarriedTooUncertain;
  record.add(11 * kPeriod_ns, lost, {}, slam::LensState::kGiven);
  EXPECT_EQ(record.livePoses().at(11).status, io::FrameStatus::kLost);
  EXPECT_EQ(record.livePoses().at(11).reason, "the carried pose is less certain than its limit");
}

TEST(RunRecord, AFrameWithoutAPoseHasNoLine) {
  const io::Trajectory trajectory = io::trajectoriesOf(walk({0, 7}).livePoses()).at(0);
  ASSERT_EQ(trajectory.size(), 8U);
  EXPECT_EQ(trajectory[0].time_ns, kPeriod_ns);
  EXPECT_EQ(trajectory[6].time_ns, 8 * kPeriod_ns);
  EXPECT_EQ(trajectory[6].T_w_c.p.x(), 8.0);
}

// How well features fit, or that a predicted pose has nothing to fit, says nothing of the lens.
TEST(RunRecord, TheReprojectionErrorIsThatOfMarkers) {
  using slam::PoseSource;
  RunRecord record;
  std::int64_t time_ns = 0;
  for (const auto& [source, rms_px] : {std::pair{PoseSource::kMarkers, 0.1},
                                       {PoseSource::kNaturalFeatures, 2.0},
                                       {PoseSource::kPrediction, 0.0},
                                       {PoseSource::kMarkers, 0.3}}) {
    slam::FrameResult result;
    result.pose.emplace();
    result.pose->source = source;
    result.pose->reprojection_rms_px = rms_px;
    record.add(time_ns += kPeriod_ns, result, {}, slam::LensState::kGiven);
  }
  EXPECT_EQ(record.localized(), 4U);
  EXPECT_NEAR(record.reprojectionRms_px(), std::sqrt((0.01 + 0.09) / 2.0), 1e-12);
}

// A camera goes on for days.
TEST(RunRecord, OfACameraTheLatestFramesAreKept) {
  RunRecord record(100);
  for (int i = 0; i < 1050; ++i) {
    slam::FrameResult result;
    if (i > 0) {
      result.pose.emplace();
      result.pose->T_w_c.p.x() = i;
      result.pose->reprojection_rms_px = 2.0;
    }
    record.add(i * kPeriod_ns, result, {}, slam::LensState::kGiven);
    ASSERT_LE(record.liveFrames().size(), 200U);
  }
  EXPECT_EQ(record.frames(), 1050U);
  EXPECT_EQ(record.localized(), 1049U);
  EXPECT_EQ(record.liveFrames().size() + record.forgotten(), 1050U);
  EXPECT_GE(record.liveFrames().size(), 100U);
  const auto poses = record.livePoses();
  ASSERT_EQ(poses.size(), record.liveFrames().size());
  EXPECT_EQ(poses.front().frame, record.forgotten());
  EXPECT_EQ(poses.back().frame, 1049U);
  EXPECT_EQ(poses.back().pose->T_w_c.p.x(), 1049.0);
  const io::Trajectory trajectory = io::trajectoriesOf(poses).at(0);
  EXPECT_EQ(trajectory.size(), record.liveFrames().size());
  EXPECT_EQ(trajectory.back().T_w_c.p.x(), 1049.0);
}

TEST(RunRecord, ALoopThatClosesAfterTheLastFrame) {
  RunRecord record;
  slam::Counters counters;
  record.add(0, {}, counters, slam::LensState::kGiven);
  counters.loop_closures = 1;
  record.add(kPeriod_ns, {}, counters, slam::LensState::kGiven);
  record.add(2 * kPeriod_ns, {}, counters, slam::LensState::kGiven);
  EXPECT_EQ(record.loopClosedAt_ns(counters), (std::vector<std::int64_t>{kPeriod_ns}));
  counters.loop_closures = 2;
  EXPECT_EQ(record.loopClosedAt_ns(counters),
            (std::vector<std::int64_t>{kPeriod_ns, 2 * kPeriod_ns}));
}

// And anew, after it has changed under way.
TEST(RunRecord, SinceWhenTheLensIsLearned) {
  using enum slam::LensState;
  RunRecord record;
  std::int64_t time_ns = 0;
  const auto with = [&](slam::LensState lens) {
    record.add(time_ns += kPeriod_ns, {}, {}, lens);
    return record.lensLearnedAt_ns();
  };
  EXPECT_EQ(with(kGiven), std::nullopt);
  EXPECT_EQ(with(kLearning), std::nullopt);
  EXPECT_EQ(with(kLearned), 3 * kPeriod_ns);
  EXPECT_EQ(with(kLearned), 3 * kPeriod_ns);
  EXPECT_EQ(with(kLearning), std::nullopt);
  EXPECT_EQ(with(kLearned), 6 * kPeriod_ns);
}

}  // namespace
}  // namespace waymark::tools
