// The stopwatches of `waymark run`: wall and CPU time of the SLAM thread, by stage.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "slam/stages.h"

namespace waymark::tools {

struct TimeSummary {
  double mean = 0.0;
  double median = 0.0;
  double p99 = 0.0;
  double p999 = 0.0;
  double max = 0.0;
};
// Percentiles by nearest rank: each is a time that was measured. Zeros for an empty list.
[[nodiscard]] TimeSummary summarize(std::vector<double> times);

class StageTimer final : public slam::StageObserver {
 public:
  // max_frames: as of RunRecord.
  explicit StageTimer(std::size_t max_frames = std::numeric_limits<std::size_t>::max())
      : max_frames_(max_frames) {}

  // Around Slam::process(): everything from having the grey frame to having the pose.
  void beginFrame();
  void endFrame();

  // A stage may run more than once in a frame; its times add up. One that does not run counts as 0.
  void begin(slam::Stage stage) override;
  void end(slam::Stage stage) override;

  // {"total":{"wall_ms":{...},"cpu_ms":{...}},"detect":...,"track":...,"map":...}, over all frames
  // that are kept.
  [[nodiscard]] nlohmann::ordered_json json() const;

  [[nodiscard]] double totalWall_ms() const { return total_wall_ms_; }  // sum over all frames

 private:
  struct Reading {
    double wall_ms = 0.0;
    double cpu_ms = 0.0;
  };
  struct Watch {
    Reading started;
    Reading frame;                // so far in this frame
    std::vector<double> wall_ms;  // one per frame
    std::vector<double> cpu_ms;
  };
  static Reading now();
  static void start(Watch& watch);
  static void stop(Watch& watch);
  void store(Watch& watch) const;

  std::size_t max_frames_;
  Watch total_;
  std::array<Watch, slam::kStages.size()> stages_;
  double total_wall_ms_ = 0.0;
};

}  // namespace waymark::tools
