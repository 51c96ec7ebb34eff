#include "daemon/frames/capture_loop.h"

#include <atomic>
#include <deque>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::daemon {
namespace {

using std::chrono::milliseconds;

enum class Step { kFrame, kTimeOut, kEnd, kError };

// Plays a script. After its last step it is silent.
class ScriptedSource final : public capture::FrameSource {
 public:
  explicit ScriptedSource(std::deque<Step> steps, double rate_hz = 0.0) : steps_(std::move(steps)) {
    info_.description = "scripted";
    info_.rate_hz = rate_hz;
    info_.live = true;
  }

  [[nodiscard]] const capture::StreamInfo& info() const override { return info_; }
  [[nodiscard]] capture::SourceCounters counters() const override { return counters_; }
  [[nodiscard]] capture::ReadResult read(milliseconds timeout) override {
    const Step step = steps_.empty() ? Step::kTimeOut : steps_.front();
    if (!steps_.empty()) steps_.pop_front();
    switch (step) {
      case Step::kFrame: {
        capture::FramePtr frame = pool_.acquire();
        if (!frame) return Error{"no buffer"};
        frame->setStamp({.sequence = counters_.frames++});
        return frame;
      }
      case Step::kTimeOut:
        std::this_thread::sleep_for(timeout);
        return capture::TimedOut{};
      case Step::kEnd:
        return capture::EndOfStream{};
      case Step::kError:
        return Error{"unplugged"};
    }
    return Error{"not reached"};
  }

 private:
  capture::FramePool pool_{1, 1, 16};
  capture::StreamInfo info_;
  capture::SourceCounters counters_;
  std::deque<Step> steps_;
};

// Each opening plays the next script, or fails where there is none.
SourceOpener scripts(std::deque<std::deque<Step>> list, bool comes_back) {
  return {[list = std::move(list)]() mutable -> Result<std::unique_ptr<capture::FrameSource>> {
            if (list.empty() || list.front().empty()) {
              if (!list.empty()) list.pop_front();
              return Error{"no such device"};
            }
            std::unique_ptr<capture::FrameSource> source =
                std::make_unique<ScriptedSource>(list.front());
            list.pop_front();
            return source;
          },
          comes_back};
}

constexpr CaptureLoop::Options kQuick{.read_timeout = milliseconds(2),
                                      .silence = {.least = milliseconds(20)},
                                      .first_pause = milliseconds(1),
                                      .max_pause = milliseconds(4)};

class CaptureLoopTest : public ::testing::Test {
 protected:
  // Takes every frame until the queue is closed, and remembers the sequences.
  void consume() {
    while (const capture::FramePtr frame = frames_.pop()) {
      sequences_.push_back(frame->stamp().sequence);
    }
  }

  Log log_{LogLevel::kError, false};
  CameraStatus status_;
  FrameQueue frames_{16};
  std::vector<std::uint64_t> sequences_;
};

TEST_F(CaptureLoopTest, ARecordingIsPlayedToItsEnd) {
  CaptureLoop loop(scripts({{Step::kFrame, Step::kTimeOut, Step::kFrame, Step::kEnd}}, false),
                   frames_, status_, log_, kQuick);
  loop.run();
  consume();
  EXPECT_EQ(sequences_, (std::vector<std::uint64_t>{0, 1}));
  EXPECT_EQ(status_.latest().state, CameraState::kEnded);
  EXPECT_EQ(status_.counters().frames, 2u);
  EXPECT_FALSE(loop.failure());
}

TEST_F(CaptureLoopTest, ARecordingThatCannotBeOpenedEndsTheRunAndSaysWhy) {
  CaptureLoop loop(scripts({}, false), frames_, status_, log_, kQuick);
  loop.run();
  consume();
  EXPECT_TRUE(sequences_.empty());
  ASSERT_TRUE(loop.failure());
  EXPECT_EQ(loop.failure()->message, "no such device");
}

TEST_F(CaptureLoopTest, ACameraThatIsNotThereYetIsWaitedFor) {
  CaptureLoop loop(scripts({}, true), frames_, status_, log_, kQuick);
  std::thread capture([&] { loop.run(); });
  while (status_.latest().reason.empty()) std::this_thread::yield();
  EXPECT_EQ(status_.latest().state, CameraState::kOpening);
  EXPECT_EQ(status_.latest().reason, "no such device");
  loop.requestStop();
  capture.join();
  EXPECT_FALSE(loop.failure());
}

TEST_F(CaptureLoopTest, ARecordingThatFailsEndsTheRunAndSaysWhy) {
  CaptureLoop loop(scripts({{Step::kFrame, Step::kError}}, false), frames_, status_, log_, kQuick);
  loop.run();
  consume();
  EXPECT_EQ(sequences_.size(), 1u);
  ASSERT_TRUE(loop.failure());
  EXPECT_EQ(loop.failure()->message, "unplugged");
}

// Fails to open, runs, is unplugged, fails to open twice, runs, falls silent, runs again.
TEST_F(CaptureLoopTest, ACameraIsOpenedAgainAsOftenAsItFails) {
  CaptureLoop loop(scripts({{},
                            {Step::kFrame, Step::kFrame, Step::kError},
                            {},
                            {},
                            {Step::kFrame},
                            {Step::kFrame, Step::kEnd}},
                           true),
                   frames_, status_, log_, kQuick);
  std::thread consumer([this] { consume(); });
  loop.run();
  consumer.join();
  EXPECT_EQ(sequences_, (std::vector<std::uint64_t>{0, 1, 2, 3})) << "the sequence goes on";
  EXPECT_EQ(status_.counters().frames, 4u) << "counters too";
  EXPECT_EQ(status_.reopened(), 2u);
}

TEST_F(CaptureLoopTest, ADeviceThatComesEndsThePause) {
  SourceOpener opener = scripts({{Step::kFrame, Step::kError}, {Step::kFrame, Step::kEnd}}, true);
  std::atomic<bool> came{false};
  opener.device_came = [&] { return came.exchange(false); };
  CaptureLoop loop(opener, frames_, status_, log_,
                   {.first_pause = milliseconds(60'000), .max_pause = milliseconds(60'000)});
  std::thread consumer([this] { consume(); });
  std::thread capture([&] { loop.run(); });
  while (status_.latest().state != CameraState::kLost) std::this_thread::yield();
  std::this_thread::sleep_for(milliseconds(50));
  EXPECT_EQ(status_.reopened(), 0u);
  came = true;
  capture.join();
  consumer.join();
  EXPECT_EQ(sequences_.size(), 2u);
  EXPECT_EQ(status_.reopened(), 1u);
}

TEST_F(CaptureLoopTest, ACameraThatFallsSilentIsCounted) {
  CaptureLoop loop(scripts({{Step::kFrame}, {Step::kFrame, Step::kEnd}}, true), frames_, status_,
                   log_, kQuick);
  std::thread consumer([this] { consume(); });
  loop.run();
  consumer.join();
  EXPECT_EQ(status_.silences(), 1u);
}

// Each by itself: the rate asked for, the exposure asked for, the rate that the camera has.
TEST_F(CaptureLoopTest, ASlowCameraIsNotSilent) {
  std::deque<Step> slow(60, Step::kTimeOut);  // 120 ms, and more
  slow.push_front(Step::kFrame);
  slow.push_back(Step::kEnd);
  const auto silences = [&](double asked_hz, double exposure_s, double rate_hz) {
    CameraStatus status;
    FrameQueue frames{16};
    int opened = 0;
    CaptureLoop loop({.open = [&]() -> Result<std::unique_ptr<capture::FrameSource>> {
                        const std::deque<Step> end = {Step::kEnd};
                        return std::unique_ptr<capture::FrameSource>(
                            std::make_unique<ScriptedSource>(opened++ == 0 ? slow : end, rate_hz));
                      },
                      .comes_back = true,
                      .rate_hz = asked_hz,
                      .exposure_s = exposure_s},
                     frames, status, log_, kQuick);
    std::thread consumer([&] {
      while (frames.pop()) {
      }
    });
    loop.run();
    consumer.join();
    return status.silences();
  };
  EXPECT_EQ(silences(0.0, 0.0, 0.0), 1U);
  EXPECT_EQ(silences(100.0, 0.001, 150.0), 1U);
  EXPECT_EQ(silences(0.1, 0.0, 0.0), 0U);
  EXPECT_EQ(silences(0.0, 10.0, 150.0), 0U);
  EXPECT_EQ(silences(0.0, 0.0, 0.1), 0U);
}

TEST(SilenceLimit, FollowsTheSlowest) {
  using capture::silenceLimit;
  EXPECT_EQ(silenceLimit(0.0, 0.0, {}), milliseconds(2000));
  EXPECT_EQ(silenceLimit(30.0, 0.01, {}), milliseconds(2000));
  EXPECT_EQ(silenceLimit(0.1, 0.01, {}), milliseconds(30'000));
  EXPECT_EQ(silenceLimit(30.0, 10.0, {}), milliseconds(30'000));
  EXPECT_EQ(silenceLimit(1e-300, 0.0, {}), milliseconds(3'600'000));
}

TEST_F(CaptureLoopTest, StopsWhileTheCameraIsAway) {
  CaptureLoop loop(scripts({{Step::kFrame, Step::kError}}, true), frames_, status_, log_,
                   {.first_pause = milliseconds(60'000), .max_pause = milliseconds(60'000)});
  std::thread consumer([this] { consume(); });
  std::thread capture([&] { loop.run(); });
  while (status_.latest().state != CameraState::kLost) std::this_thread::yield();
  EXPECT_EQ(status_.latest().reason, "unplugged");
  loop.requestStop();
  capture.join();
  consumer.join();
  EXPECT_EQ(sequences_.size(), 1u);
}

TEST_F(CaptureLoopTest, AStopNeedNotWaitForASlamThatIsBehind) {
  CaptureLoop loop(scripts({{Step::kFrame, Step::kFrame, Step::kFrame}}, true), frames_, status_,
                   log_,
                   {.read_timeout = milliseconds(2), .silence = {.least = milliseconds(60'000)}});
  std::thread capture([&] { loop.run(); });
  while (frames_.pushed() < 3) std::this_thread::yield();
  EXPECT_EQ(frames_.pop()->stamp().sequence, 0U);
  loop.requestStop();
  capture.join();
  consume();
  EXPECT_EQ(sequences_, std::vector<std::uint64_t>{2});
  EXPECT_EQ(frames_.dropped(), 1U);
}

// The source's buffers die with it, so it must wait for a consumer that is slow to let go.
TEST_F(CaptureLoopTest, ASourceIsKeptUntilItsFramesAreBack) {
  CaptureLoop loop(scripts({{Step::kFrame, Step::kError}, {Step::kEnd}}, true), frames_, status_,
                   log_, kQuick);
  std::thread capture([&] { loop.run(); });
  capture::FramePtr held = frames_.pop();
  while (status_.latest().state != CameraState::kLost) std::this_thread::yield();
  std::this_thread::sleep_for(milliseconds(30));
  EXPECT_EQ(status_.reopened(), 0u) << "reopened while a frame was out";
  held->pixels()[0] = 1;  // the address sanitizer would object
  held.reset();
  consume();
  capture.join();
  EXPECT_EQ(status_.latest().state, CameraState::kEnded);
}

}  // namespace
}  // namespace waymark::daemon
