#include "tools/progress_bar.h"

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <string>

#include <sys/ioctl.h>
#include <unistd.h>

#include "base/clock.h"

namespace waymark::tools {
namespace {

constexpr std::int64_t kInterval_ns = 100'000'000;
constexpr std::size_t kBarWidth = 20;  // characters

// Of the terminal; 80 where nobody knows.
std::size_t columns() {
  winsize size{};
  if (::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return 80;
  return size.ws_col;
}

std::string bar(double fraction) {
  fraction = std::clamp(fraction, 0.0, 1.0);  // headers promise what they like
  const auto full = static_cast<std::size_t>(fraction * static_cast<double>(kBarWidth));
  std::string text = "[";
  for (std::size_t i = 0; i < kBarWidth; ++i) text += i < full ? '=' : ' ';
  char percent[16];
  std::snprintf(percent, sizeof percent, "] %3.0f %%  ", 100.0 * fraction);
  return text + percent;
}

// "1:05" minutes, "2:03:04" hours.
std::string clockTime(double seconds) {
  const auto all = static_cast<long long>(seconds + 0.5);
  char text[32];
  if (all < 3600) {
    std::snprintf(text, sizeof text, "%lld:%02lld", all / 60, all % 60);
  } else {
    std::snprintf(text, sizeof text, "%lld:%02lld:%02lld", all / 3600, all / 60 % 60, all % 60);
  }
  return text;
}

}  // namespace

ProgressBar::ProgressBar(std::optional<std::int64_t> total, bool wanted)
    : total_(total), active_(wanted && ::isatty(STDERR_FILENO) == 1), started_ns_(monotonicNs()) {}

ProgressBar::~ProgressBar() {
  if (drawn_) std::fputs("\r\033[K", stderr);
}

// One column stays free: a line that fills the last one is broken by some terminals.
std::string progressText(const Progress& progress) {
  const double seconds = std::max(progress.seconds, 1e-6);
  const double rate = static_cast<double>(progress.frames) / seconds;
  std::string line;
  if (progress.total > 0) {
    line += bar(static_cast<double>(progress.frames) / static_cast<double>(progress.total));
  }
  char text[80];
  std::snprintf(text, sizeof text, "%lld frames  %.0f fps", static_cast<long long>(progress.frames),
                rate);
  line += text;
  const std::int64_t left = progress.total - progress.frames;
  if (left > 0 && progress.frames > 0) {
    line += "  " + clockTime(static_cast<double>(left) / rate) + " left";
  }
  if (!progress.more.empty()) line += "  " + progress.more;
  const std::size_t most = progress.columns > 1 ? progress.columns - 1 : 0;
  return line.substr(0, most);
}

void ProgressBar::update(std::int64_t frames, const std::function<std::string()>& more) {
  if (!active_) return;
  const std::int64_t now = monotonicNs();
  if (now < next_ns_) return;
  next_ns_ = now + kInterval_ns;
  const std::string line =
      "\r\033[K" + progressText({.frames = frames,
                                 .total = total_.value_or(0),
                                 .seconds = 1e-9 * static_cast<double>(now - started_ns_),
                                 .more = more ? more() : std::string(),
                                 .columns = columns()});
  std::fputs(line.c_str(), stderr);
  std::fflush(stderr);
  drawn_ = true;
}

}  // namespace waymark::tools
