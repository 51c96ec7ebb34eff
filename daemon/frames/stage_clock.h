// What a frame's time went into, so that a missed deadline has a cause.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "base/clock.h"
#include "slam/stages.h"

namespace waymark::daemon {

// The stages of the SLAM, by their number, and then what belongs to none of them.
inline constexpr std::size_t kOtherStage = slam::kStages.size();
inline constexpr auto kFrameStages = [] {
  std::array<slam::NamedStage, kOtherStage + 1> stages{};
  std::ranges::copy(slam::kStages, stages.begin());
  stages[kOtherStage] = {"other", "none of these"};
  return stages;
}();

// For one thread; one frame after the other.
class StageClock final : public slam::StageObserver {
 public:
  // alive_ns (may be null) gets the monotonic time of the last step, for other threads to see.
  explicit StageClock(std::atomic<std::int64_t>* alive_ns = nullptr) : alive_ns_(alive_ns) {}

  void beginFrame() {
    spent_ns_.fill(0);
    frame_began_ns_ = monotonicNs();
  }
  void begin(slam::Stage /*stage*/) override { began_ns_ = step(); }
  void end(slam::Stage stage) override {
    spent_ns_[static_cast<std::size_t>(stage)] += step() - began_ns_;
  }
  void advance() override { step(); }
  // Nanoseconds since beginFrame().
  std::int64_t endFrame() {
    const std::int64_t total_ns = monotonicNs() - frame_began_ns_;
    std::int64_t stages_ns = 0;
    for (const std::int64_t spent_ns : spent_ns_) stages_ns += spent_ns;
    spent_ns_[kOtherStage] = total_ns - stages_ns;
    return total_ns;
  }

  // After endFrame(): of kFrameStages.
  [[nodiscard]] std::size_t longest() const {
    return static_cast<std::size_t>(std::ranges::max_element(spent_ns_) - spent_ns_.begin());
  }

 private:
  // The time.
  std::int64_t step() {
    const std::int64_t now_ns = monotonicNs();
    if (alive_ns_ != nullptr) alive_ns_->store(now_ns, std::memory_order_relaxed);
    return now_ns;
  }

  std::atomic<std::int64_t>* alive_ns_;
  std::array<std::int64_t, kFrameStages.size()> spent_ns_{};
  std::int64_t frame_began_ns_ = 0;
  std::int64_t began_ns_ = 0;
};

}  // namespace waymark::daemon
