// How far a long piece of work is, on a terminal. Silent everywhere else.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace waymark::tools {

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
