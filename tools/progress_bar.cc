#include "tools/progress_bar.h"

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <string>

#include <unistd.h>

#include "base/clock.h"

namespace waymark::tools {
namespace {

constexpr std::int64_t kInterval_ns = 100'000'000;
constexpr std::size_t kBarWidth = 28;  // characters

std::string bar(double fraction) {
  const auto full =
      static_cast<std::size_t>(std::clamp(fraction, 0.0, 1.0) * static_cast<double>(kBarWidth));
  std::string text = "[";
  for (std::size_t i = 0; i < kBarWidth; ++i) text += i < full ? '=' : ' ';
  char percent[16];
  std::snprintf(percent, sizeof percent, "] %3.0f %%  ", 100.0 * fraction);
  return text + percent;
}

}  // namespace

ProgressBar::ProgressBar(std::optional<std::int64_t> total, bool wanted)
    : total_(total), active_(wanted && ::isatty(STDERR_FILENO) == 1), started_ns_(monotonicNs()) {}

ProgressBar::~ProgressBar() {
  if (drawn_) std::fputs("\r\033[K", stderr);
}

void ProgressBar::update(std::int64_t frames, const std::function<std::string()>& more) {
  if (!active_) return;
  const std::int64_t now = monotonicNs();
  if (now < next_ns_) return;
  next_ns_ = now + kInterval_ns;
  const double seconds = std::max(1e-9 * static_cast<double>(now - started_ns_), 1e-6);
  std::string line = "\r\033[K";
  if (total_ && *total_ > 0) {
    line += bar(static_cast<double>(frames) / static_cast<double>(*total_));
  }
  char text[80];
  std::snprintf(text, sizeof text, "%lld frames  %.0f fps", static_cast<long long>(frames),
                static_cast<double>(frames) / seconds);
  line += text;
  if (more) line += "  " + more();
  std::fputs(line.c_str(), stderr);
  std::fflush(stderr);
  drawn_ = true;
}

}  // namespace waymark::tools
