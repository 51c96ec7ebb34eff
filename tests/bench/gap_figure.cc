#include "tests/bench/gap_figure.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>

#include "tests/bench/formatted.h"

namespace waymark::bench {
namespace {

constexpr double kWidth = 720.0;
constexpr double kHeight = 120.0;  // of a panel
constexpr double kLeft = 60.0;     // room for its numbers
constexpr double kGap = 26.0;      // below it
constexpr double kTop = 24.0;      // of the figure: the legend
constexpr double kLine = 12.0;     // of text
// Blue and orange: told apart by the colour-blind, too.
constexpr std::array<const char*, 3> kColours = {"#0072b2", "#d55e00", "#555555"};

struct Panel {
  const char* title;
  double factor;  // of metres
  std::function<double(const GapSample&)> value;
};

// Of a panel's values, with zero, and some room.
struct Range {
  double low = 0.0;
  double high = 0.0;
};

Range rangeOf(const Panel& panel, const std::vector<GapTrack>& tracks) {
  Range range;
  for (const GapTrack& track : tracks) {
    for (const GapSample& sample : track.samples) {
      const double value = panel.factor * panel.value(sample);
      range.low = std::min(range.low, value);
      range.high = std::max(range.high, value);
    }
  }
  const double room = std::max(0.05 * (range.high - range.low), 0.1);
  return {range.low - room, range.high + room};
}

std::string lineAt(double y, const char* label) {
  return formatted("<path d=\"M%.1f %.1fH%.1f\" stroke=\"#bbb\"/>\n", kLeft, y, kWidth) +
         formatted("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"end\">%s</text>\n", kLeft - 5.0,
                   y + 3.5, label);
}

std::string panelAt(double top, const Panel& panel, const std::vector<GapTrack>& tracks,
                    double duration_s) {
  const Range range = rangeOf(panel, tracks);
  const auto yOf = [&](double value) {
    return top + kHeight * (range.high - value) / (range.high - range.low);
  };
  std::string svg =
      formatted("<text x=\"%.1f\" y=\"%.1f\">%s</text>\n", kLeft + 6.0, top + 12.0, panel.title);
  for (const double value : {range.low, 0.0, range.high}) {
    const bool at_zero = value != 0.0 && std::abs(yOf(value) - yOf(0.0)) < kLine;
    svg += lineAt(yOf(value), at_zero ? "" : formatted("%.3g", value).c_str());
  }
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    std::string dots;
    for (const GapSample& sample : tracks[i].samples) {
      const double x = kLeft + (kWidth - kLeft) * sample.time_s / duration_s;
      dots += formatted("M%.1f %.1fh.01", x, yOf(panel.factor * panel.value(sample)));
    }
    svg += formatted(
               "<path fill=\"none\" stroke=\"%s\" stroke-width=\"2.4\" stroke-linecap=\"round\" "
               "d=\"",
               kColours[i % kColours.size()]) +
           dots + "\"/>\n";
  }
  return svg;
}

}  // namespace

std::string gapFigure(const std::vector<GapTrack>& tracks, double duration_s) {
  const std::array panels = {
      Panel{"error in x, mm", 1e3, [](const GapSample& s) { return s.error_m.x(); }},
      Panel{"error in y, mm", 1e3, [](const GapSample& s) { return s.error_m.y(); }},
      Panel{"error in height, mm", 1e3, [](const GapSample& s) { return s.error_m.z(); }},
      Panel{"distance travelled, m", 1.0, [](const GapSample& s) { return s.way_m; }},
  };
  const double height = kTop + static_cast<double>(panels.size()) * (kHeight + kGap) + 6.0;
  std::string svg = formatted(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%.0f\" height=\"%.0f\" "
      "font-family=\"sans-serif\" font-size=\"11\">\n"
      "<title>Poses over time: how far they are off</title>\n"
      "<rect width=\"100%%\" height=\"100%%\" fill=\"white\"/>\n",
      kWidth + 20.0, height);
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    svg += formatted("<text x=\"%.1f\" y=\"15\" fill=\"%s\">%s</text>\n",
                     kLeft + 220.0 * static_cast<double>(i), kColours[i % kColours.size()],
                     tracks[i].name.c_str());
  }
  double top = kTop;
  for (const Panel& panel : panels) {
    svg += panelAt(top, panel, tracks, duration_s);
    top += kHeight + kGap;
  }
  for (int second = 0; second <= static_cast<int>(duration_s); second += 2) {
    svg += formatted("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\">%d s</text>\n",
                     kLeft + (kWidth - kLeft) * second / duration_s, top - 8.0, second);
  }
  return svg + "</svg>\n";
}

}  // namespace waymark::bench
