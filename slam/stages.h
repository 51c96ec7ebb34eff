// What a frame's time goes into. The SLAM has no clock of its own, so it tells a StageObserver when
// a stage begins and ends.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace waymark::slam {

enum class Stage : std::uint8_t { kDetect, kTrack, kFeatures, kMap };

struct NamedStage {
  const char* name;  // in stats.json, and after "deadline.missed_" in health messages
  const char* does;  // as docs/health.md says it
};

// Every stage, by its number.
inline constexpr std::array kStages = {
    NamedStage{"detect", "finding markers"},
    NamedStage{"track", "the pose"},
    NamedStage{"features", "natural features, and the pose between markers"},
    NamedStage{"map", "new keyframes and optimization"},
};
static_assert(kStages.size() == static_cast<std::size_t>(Stage::kMap) + 1, "one is missing here");

// The caller's stopwatch.
class StageObserver {
 public:
  virtual ~StageObserver() = default;
  virtual void begin(Stage stage) = 0;
  virtual void end(Stage stage) = 0;
  // Within a stage that may take long: another step of it is done.
  virtual void advance() {}
};

// Brackets a stage; the observer may be null.
class StageScope {
 public:
  StageScope(StageObserver* observer, Stage stage) : observer_(observer), stage_(stage) {
    if (observer_ != nullptr) observer_->begin(stage_);
  }
  ~StageScope() {
    if (observer_ != nullptr) observer_->end(stage_);
  }
  StageScope(const StageScope&) = delete;
  StageScope& operator=(const StageScope&) = delete;

 private:
  StageObserver* observer_;
  Stage stage_;
};

}  // namespace waymark::slam
