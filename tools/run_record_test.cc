#include "tools/run_record.h"

#include <set>

#include <gtest/gtest.h>

namespace waymark::tools {
namespace {

constexpr int kFrames = 1000;

// Marker 1 is in every frame, marker 2 in a few; frames without a pose are those of `lost`.
RunRecord walk(const std::set<int>& with_marker_2, const std::set<int>& lost) {
  RunRecord record;
  for (int i = 0; i < kFrames; ++i) {
    std::vector<slam::MarkerDetection> detections(1);
    detections[0].id = 1;
    if (with_marker_2.contains(i)) detections.emplace_back().id = 2;
    slam::FrameResult result;
    result.detections = detections;
    if (!lost.contains(i)) {
      result.pose.emplace();
      result.pose->T_w_c.p.x() = i;
    }
    record.add(i, result, {});
  }
  return record;
}

std::set<int> numbersOf(const std::vector<slam::RecordedFrame>& frames) {
  std::set<int> numbers;
  for (const slam::RecordedFrame& frame : frames) {
    numbers.insert(static_cast<int>(frame.sequence));
  }
  return numbers;
}

TEST(RunRecord, SpreadsFramesEvenly) {
  const RunRecord record = walk({}, {});
  EXPECT_EQ(numbersOf(record.spreadFrames(4, 0)), (std::set<int>{0, 250, 500, 750}));
  EXPECT_EQ(record.spreadFrames(2 * kFrames, 0).size(), std::size_t{kFrames});
  EXPECT_TRUE(record.spreadFrames(0, 0).empty());
}

TEST(RunRecord, AMarkerThatIsSeldomSeenCountsEveryView) {
  const RunRecord record = walk({601, 602, 603, 604, 605}, {});
  EXPECT_EQ(numbersOf(record.spreadFrames(4, 5)),
            (std::set<int>{0, 200, 250, 400, 500, 600, 601, 602, 603, 604, 605, 750, 800}));
  const auto some = numbersOf(record.spreadFrames(4, 2));
  EXPECT_EQ(some, (std::set<int>{0, 250, 500, 601, 603, 750})) << "spread over its frames, too";
}

TEST(RunRecord, FramesWithoutAPoseKeepTheirPlace) {
  const RunRecord record = walk({7}, {0, 7, 500});
  const auto frames = record.framesWithoutPose();
  EXPECT_EQ(numbersOf(frames), (std::set<int>{0, 7, 500}));
  EXPECT_EQ(frames[1].detections.size(), 2U);
}

TEST(RunRecord, ALostFrameStartsFromItsNeighbour) {
  const RunRecord record = walk({}, {0, 1, 2, 500, 501});
  const auto frames = record.spreadFrames(kFrames, 0);
  ASSERT_EQ(frames.size(), std::size_t{kFrames});
  EXPECT_EQ(frames[0].T_w_c.p.x(), 3.0) << "in front of the first pose";
  EXPECT_EQ(frames[501].T_w_c.p.x(), 499.0);
  EXPECT_EQ(frames[502].T_w_c.p.x(), 502.0);

  std::set<int> all;
  for (int i = 0; i < kFrames; ++i) all.insert(i);
  EXPECT_TRUE(walk({}, all).spreadFrames(kFrames, 5).empty()) << "nothing to start from";
}

}  // namespace
}  // namespace waymark::tools
