// How far a long piece of work is, on a terminal. Silent everywhere else.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace waymark::tools {

struct Progress {
  std::int64_t frames = 0;
  std::int64_t total = 0;  // 0: nobody knows
  double seconds = 0.0;    // since the first one
  std::string more;        // what else there is to say
  std::size_t columns = 80;
};

// The bar, the frames, how fast, and how long it will still take; cut to the terminal's width, as a
// line that is broken cannot be drawn over. ASCII only.
[[nodiscard]] std::string progressText(const Progress& progress);

class ProgressBar {
 public:
  // `total` frames, where known. Draws only when `wanted` and stderr is a terminal.
  ProgressBar(std::optional<std::int64_t> total, bool wanted);
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;
  ~ProgressBar();  // clears the line

  // So many frames are done; `more` is what else there is to say, asked only when it is drawn.
  // Cheap; draws at most ten times a second.
  void update(std::int64_t frames, const std::function<std::string()>& more = nullptr);

 private:
  std::optional<std::int64_t> total_;
  bool active_;
  bool drawn_ = false;
  std::int64_t started_ns_ = 0;  // monotonic
  std::int64_t next_ns_ = 0;     // monotonic
};

}  // namespace waymark::tools
