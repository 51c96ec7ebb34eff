#include "capture/paced_source.h"

#include <ctime>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::capture {
namespace {

using std::chrono_literals::operator""ms;

std::int64_t monotonicNow_ns() {
  timespec time{};
  clock_gettime(CLOCK_MONOTONIC, &time);
  return static_cast<std::int64_t>(time.tv_sec) * 1'000'000'000 + time.tv_nsec;
}

// A recording of `count` tiny frames, 10 ms apart.
class Recording final : public FrameSource {
 public:
  explicit Recording(std::uint64_t count) : count_(count) {
    info_.rate_hz = 100.0;
    info_.width = info_.height = 1;
  }
  [[nodiscard]] const StreamInfo& info() const override { return info_; }
  [[nodiscard]] SourceCounters counters() const override { return {}; }
  [[nodiscard]] ReadResult read(std::chrono::milliseconds) override {
    if (next_ == count_) return EndOfStream{};
    FramePtr frame = pool_.acquire();
    if (!frame) return TimedOut{};
    frame->setStamp(
        {.sequence = next_,
         .monotonic_ns = 5'000'000'000 + static_cast<std::int64_t>(next_) * 10'000'000});
    ++next_;
    return frame;
  }

 private:
  std::uint64_t count_;
  std::uint64_t next_ = 0;
  StreamInfo info_;
  FramePool pool_{1, 1, 2};
};

TEST(PacedSource, FramesComeWhenTheyAreDueAndAreStampedWithIt) {
  const auto source = playInRealTime(std::make_unique<Recording>(6), std::nullopt);
  EXPECT_TRUE(source->info().live);
  std::vector<FrameStamp> stamps;
  for (;;) {
    const ReadResult result = source->read(1000ms);
    const FramePtr* frame = std::get_if<FramePtr>(&result);
    if (frame == nullptr) break;
    EXPECT_GE(monotonicNow_ns(), (*frame)->stamp().monotonic_ns);
    stamps.push_back((*frame)->stamp());
  }
  // A busy machine may drop some: what is handed out must still be where it belongs in time.
  ASSERT_FALSE(stamps.empty());
  for (const FrameStamp& stamp : stamps) {
    EXPECT_EQ(stamp.monotonic_ns - stamps[0].monotonic_ns,
              static_cast<std::int64_t>(stamp.sequence - stamps[0].sequence) * 10'000'000);
  }
  EXPECT_EQ(source->counters().frames + source->counters().dropped_late, 6U);
}

TEST(PacedSource, GivenRateReplacesTheRecordings) {
  const auto source = playInRealTime(std::make_unique<Recording>(3), 20.0);
  const ReadResult first = source->read(1000ms);
  const ReadResult second = source->read(1000ms);
  ASSERT_TRUE(std::holds_alternative<FramePtr>(first));
  ASSERT_TRUE(std::holds_alternative<FramePtr>(second));
  EXPECT_EQ(std::get<FramePtr>(second)->stamp().monotonic_ns -
                std::get<FramePtr>(first)->stamp().monotonic_ns,
            50'000'000);
}

TEST(PacedSource, WaitsNoLongerThanAsked) {
  const auto source = playInRealTime(std::make_unique<Recording>(3), 0.01);
  EXPECT_TRUE(std::holds_alternative<FramePtr>(source->read(0ms)));
  const std::int64_t before = monotonicNow_ns();
  EXPECT_TRUE(std::holds_alternative<TimedOut>(source->read(20ms)));
  EXPECT_GE(monotonicNow_ns() - before, 20'000'000);
  EXPECT_LT(monotonicNow_ns() - before, 5'000'000'000);
}

TEST(PacedSource, LateFramesAreDroppedAndCounted) {
  const auto source = playInRealTime(std::make_unique<Recording>(10), std::nullopt);
  ASSERT_TRUE(std::holds_alternative<FramePtr>(source->read(1000ms)));
  std::this_thread::sleep_for(65ms);  // the first five after it are more than 10 ms late now
  const ReadResult next = source->read(1000ms);
  ASSERT_TRUE(std::holds_alternative<FramePtr>(next));
  EXPECT_GE(std::get<FramePtr>(next)->stamp().sequence, 6U);
  EXPECT_EQ(source->counters().dropped_late, std::get<FramePtr>(next)->stamp().sequence - 1);
}

}  // namespace
}  // namespace waymark::capture
