// How far a run is, on a terminal. Silent everywhere else.
#pragma once

#include <cstdint>
#include <optional>

namespace waymark::tools {

struct Progress {
  std::size_t frames = 0;
  double localized_percent = 0.0;
  std::size_t markers = 0;
};

class ProgressBar {
 public:
  // `total` frames, where known. Draws only when `wanted` and stderr is a terminal.
  ProgressBar(std::optional<std::int64_t> total, bool wanted);
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;
  ~ProgressBar();  // clears the line

  // Cheap; draws at most ten times a second.
  void update(const Progress& progress);

 private:
  std::optional<std::int64_t> total_;
  bool active_;
  bool drawn_ = false;
  std::int64_t started_ns_ = 0;
  std::int64_t next_ns_ = 0;
};

}  // namespace waymark::tools
