#include "capture/camera_buffers.h"

#include <chrono>
#include <cstdint>
#include <set>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::capture {
namespace {

using std::chrono_literals::operator""ms;

// Four buffers, all of them with the camera.
class CameraBuffersTest : public ::testing::Test {
 protected:
  CameraBuffersTest() {
    for (int i = 0; i < buffers_.count(); ++i) buffers_.given();
  }

  // Takes one buffer with a frame of this number, after others or alone.
  void takeOneMore(std::uint32_t sequence) {
    buffers_.taken();
    buffers_.countFrame(sequence, &counters_);
  }
  void takeAlone(std::uint32_t sequence) {
    buffers_.beginTaking();
    takeOneMore(sequence);
  }
  void takeAndGiveBack(std::uint32_t sequence) {
    takeAlone(sequence);
    buffers_.given();
  }

  CameraBuffers buffers_{4};
  SourceCounters counters_;
};

TEST_F(CameraBuffersTest, CountsWhatTheCameraHas) {
  EXPECT_EQ(buffers_.withCamera(), 4);
  takeAlone(0);
  EXPECT_EQ(buffers_.withCamera(), 3);
  buffers_.given();
  EXPECT_EQ(buffers_.withCamera(), 4);
}

TEST_F(CameraBuffersTest, FramesInARowLoseNothing) {
  for (const std::uint32_t sequence : {17U, 18U, 19U}) {
    takeAndGiveBack(sequence);
    EXPECT_EQ(buffers_.sequence(), sequence - 17) << "counted from the first one";
  }
  EXPECT_EQ(counters_.dropped_gap, 0U);
  EXPECT_EQ(counters_.dropped_no_buffer, 0U);
}

TEST_F(CameraBuffersTest, NumbersLeftOutAreGapsWhileTheCameraHasBuffers) {
  takeAndGiveBack(5);
  takeAndGiveBack(9);
  EXPECT_EQ(counters_.dropped_gap, 3U);
  EXPECT_EQ(counters_.dropped_no_buffer, 0U);
  EXPECT_EQ(buffers_.sequence(), 4U);
}

TEST_F(CameraBuffersTest, NumbersLeftOutAfterItHadNoneWereForWantOfBuffers) {
  for (const std::uint32_t sequence : {0U, 1U, 2U, 3U}) takeAlone(sequence);
  EXPECT_EQ(buffers_.withCamera(), 0);
  for (int i = 0; i < 4; ++i) buffers_.given();
  takeAndGiveBack(6);
  EXPECT_EQ(counters_.dropped_no_buffer, 2U);
  EXPECT_EQ(counters_.dropped_gap, 0U);
  // That was then.
  takeAndGiveBack(8);
  EXPECT_EQ(counters_.dropped_no_buffer, 2U);
  EXPECT_EQ(counters_.dropped_gap, 1U);
}

TEST_F(CameraBuffersTest, AllFilledAtOnceIsNoBufferLeftAlthoughSomeAreGivenBackMeanwhile) {
  buffers_.beginTaking();
  takeOneMore(0);
  for (const std::uint32_t sequence : {1U, 2U, 3U}) {
    takeOneMore(sequence);
    buffers_.given();  // the one before: it came too late
  }
  EXPECT_EQ(buffers_.withCamera(), 3);
  takeAndGiveBack(14);
  EXPECT_EQ(counters_.dropped_no_buffer, 10U);
  EXPECT_EQ(counters_.dropped_gap, 0U);
}

TEST_F(CameraBuffersTest, SeveralAtOnceButNotAllIsNoStarvation) {
  buffers_.beginTaking();
  takeOneMore(0);
  for (const std::uint32_t sequence : {1U, 2U}) {
    takeOneMore(sequence);
    buffers_.given();
  }
  takeAndGiveBack(5);
  EXPECT_EQ(counters_.dropped_no_buffer, 0U);
  EXPECT_EQ(counters_.dropped_gap, 2U);
}

TEST_F(CameraBuffersTest, ACountThatWrapsGoesOn) {
  takeAndGiveBack(0xFFFFFFFEU);
  takeAndGiveBack(1);
  EXPECT_EQ(counters_.dropped_gap, 2U);
  EXPECT_EQ(buffers_.sequence(), 3U);
}

TEST_F(CameraBuffersTest, ACountThatStartsAgainOrStandsStillLosesNothing) {
  for (const std::uint32_t sequence : {1000U, 0U, 0U, 0U}) takeAndGiveBack(sequence);
  EXPECT_EQ(counters_.dropped_gap, 0U);
  EXPECT_EQ(counters_.dropped_no_buffer, 0U);
  EXPECT_EQ(buffers_.sequence(), 3U);
}

TEST_F(CameraBuffersTest, BuffersComeBackWhenTheirFramesAreLetGo) {
  std::set<int> held = {1, 2};
  std::vector<int> given;
  const auto take_back = [&] {
    return buffers_.takeBack([&](int index) { return held.contains(index); },
                             [&](int index) {
                               given.push_back(index);
                               return success();
                             });
  };
  buffers_.show(1);
  buffers_.show(2);
  EXPECT_TRUE(take_back());
  EXPECT_TRUE(given.empty());
  held = {1};
  EXPECT_TRUE(take_back());
  EXPECT_TRUE(take_back());
  EXPECT_EQ(given, std::vector<int>({2})) << "once, and none that was not shown";
  held = {};
  EXPECT_TRUE(take_back());
  EXPECT_EQ(given, std::vector<int>({2, 1}));
}

TEST_F(CameraBuffersTest, ABufferThatIsNotTakenBackIsAnError) {
  buffers_.show(3);
  const Status status =
      buffers_.takeBack([](int) { return false; }, [](int) -> Status { return Error{"gone"}; });
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().message, "gone");
}

TEST_F(CameraBuffersTest, OnlyWithFewBuffersAtTheCameraWaitingIsCutShort) {
  takeAlone(0);
  takeAlone(1);
  EXPECT_EQ(buffers_.patience(200ms), 200ms);
  takeAlone(2);
  EXPECT_EQ(buffers_.patience(200ms), 1ms);
  EXPECT_EQ(buffers_.patience(std::chrono::nanoseconds(5)), std::chrono::nanoseconds(5));
}

}  // namespace
}  // namespace waymark::capture
