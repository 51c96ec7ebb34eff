#include "capture/paced_source.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <ctime>
#include <utility>

#include "base/clock.h"

namespace waymark::capture {
namespace {

constexpr double kFallbackRate = 30.0;  // Hz, for recordings of unknown rate
constexpr std::int64_t kPause_ns = 1'000'000;

void sleepUntil(std::int64_t monotonic_ns) {
  const timespec until{static_cast<time_t>(monotonic_ns / 1'000'000'000),
                       static_cast<long>(monotonic_ns % 1'000'000'000)};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

class PacedSource final : public FrameSource {
 public:
  PacedSource(std::unique_ptr<FrameSource> recording, std::optional<double> rate_hz)
      : recording_(std::move(recording)), info_(recording_->info()), given_rate_(rate_hz) {
    if (rate_hz) info_.rate_hz = *rate_hz;
    info_.live = true;
    info_.description += ", in real time";
    const double rate = info_.rate_hz > 0.0 ? info_.rate_hz : kFallbackRate;
    period_ns_ = std::llround(1e9 / rate);
  }

  [[nodiscard]] const StreamInfo& info() const override { return info_; }
  [[nodiscard]] SourceCounters counters() const override { return counters_; }
  [[nodiscard]] std::string damage() const override { return recording_->damage(); }

  [[nodiscard]] ReadResult read(std::chrono::milliseconds timeout) override {
    const std::int64_t deadline_ns = monotonicNs() + std::chrono::nanoseconds(timeout).count();
    for (;;) {
      if (!next_) {
        ReadResult result = recording_->read(timeout);
        // A recording says so at once when every buffer is out: give them time to come back.
        if (std::holds_alternative<TimedOut>(result)) sleepUntil(monotonicNs() + kPause_ns);
        if (!std::holds_alternative<FramePtr>(result)) return result;
        next_ = std::get<FramePtr>(std::move(result));
      }
      const std::int64_t due = due_ns(next_->stamp());
      if (due > std::max(deadline_ns, monotonicNs())) {
        sleepUntil(deadline_ns);
        return TimedOut{};
      }
      sleepUntil(due);
      if (monotonicNs() - due <= period_ns_) return handOut(due);
      next_.reset();
      ++counters_.dropped_late;
      if (monotonicNs() > deadline_ns) return TimedOut{};
    }
  }

 private:
  std::int64_t due_ns(const FrameStamp& stamp) {
    if (!started_) {
      started_ = Start{stamp, monotonicNs(), wallUs()};
    }
    const std::int64_t since_first =
        given_rate_
            ? std::llround(1e9 * static_cast<double>(stamp.sequence - started_->first.sequence) /
                           *given_rate_)
            : stamp.monotonic_ns - started_->first.monotonic_ns;
    return started_->monotonic_ns + since_first;
  }

  ReadResult handOut(std::int64_t due) {
    FrameStamp stamp = next_->stamp();
    stamp.monotonic_ns = due;
    stamp.utime = started_->wall_us + (due - started_->monotonic_ns) / 1000;
    next_->setStamp(stamp);
    ++counters_.frames;
    return std::move(next_);
  }

  struct Start {
    FrameStamp first;  // as recorded
    std::int64_t monotonic_ns;
    std::int64_t wall_us;
  };

  std::unique_ptr<FrameSource> recording_;  // outlives next_: its pool owns the pixels
  StreamInfo info_;
  std::optional<double> given_rate_;
  std::int64_t period_ns_ = 0;
  std::optional<Start> started_;
  FramePtr next_;  // read, but not due yet
  SourceCounters counters_;
};

}  // namespace

std::unique_ptr<FrameSource> playInRealTime(std::unique_ptr<FrameSource> recording,
                                            std::optional<double> rate_hz) {
  return std::make_unique<PacedSource>(std::move(recording), rate_hz);
}

}  // namespace waymark::capture
