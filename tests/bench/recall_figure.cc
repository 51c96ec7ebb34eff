#include "tests/bench/recall_figure.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "tests/bench/formatted.h"

namespace waymark::bench {
namespace {

constexpr int kCellWidth = 20;
constexpr int kCellHeight = 16;
constexpr int kLeft = 40;  // of a panel: room for its numbers
constexpr int kTop = 44;

std::string textAt(int x, int y, const char* anchor, const std::string& text) {
  return formatted("<text x=\"%d\" y=\"%d\" text-anchor=\"%s\">", x, y, anchor) + text +
         "</text>\n";
}

// From white, nothing is found, to dark green, everything is.
std::string colourOf(double percent) {
  const double share = std::clamp(percent / 100.0, 0.0, 1.0);
  const auto channel = [&](int none, int all) {
    return static_cast<int>(std::lround(none + share * (all - none)));
  };
  return formatted("#%02x%02x%02x", channel(255, 20), channel(255, 110), channel(255, 60));
}

std::string panelAt(int x0, int y0, const RecallPanel& panel, const std::vector<double>& sides_px,
                    const std::vector<double>& blurs_px) {
  std::string svg = textAt(x0 + kLeft, y0 + 14, "start",
                           panel.detector + formatted(", noise %g", panel.noise_sigma));
  svg += textAt(x0 + kLeft - 6, y0 + kTop - 8, "end", "px");
  for (std::size_t column = 0; column < sides_px.size(); ++column) {
    const int x = x0 + kLeft + kCellWidth * static_cast<int>(column);
    svg += textAt(x + kCellWidth / 2, y0 + kTop - 8, "middle", formatted("%g", sides_px[column]));
    for (std::size_t row = 0; row < blurs_px.size(); ++row) {
      const int y = y0 + kTop + kCellHeight * static_cast<int>(row);
      const double percent = panel.percent[row * sides_px.size() + column];
      svg += formatted("<rect x=\"%d\" y=\"%d\" width=\"%d\" height=\"%d\" fill=\"%s\"/>\n", x, y,
                       kCellWidth - 1, kCellHeight - 1, colourOf(percent).c_str());
    }
  }
  for (std::size_t row = 0; row < blurs_px.size(); ++row) {
    svg += textAt(x0 + kLeft - 6, y0 + kTop + kCellHeight * static_cast<int>(row) + 12, "end",
                  formatted("%g", blurs_px[row]));
  }
  return svg;
}

}  // namespace

std::string recallFigure(const std::vector<RecallPanel>& panels,
                         const std::vector<double>& sides_px, const std::vector<double>& blurs_px) {
  const auto columns = static_cast<int>(std::ranges::count(
      panels, panels.empty() ? 0.0 : panels.front().noise_sigma, &RecallPanel::noise_sigma));
  const int width = kLeft + kCellWidth * static_cast<int>(sides_px.size()) + 24;
  const int height = kTop + kCellHeight * static_cast<int>(blurs_px.size()) + 12;
  const int rows = columns == 0 ? 0 : static_cast<int>(panels.size()) / columns;
  std::string svg = formatted(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" "
      "font-family=\"sans-serif\" font-size=\"9\">\n"
      "<title>Markers found, by side (across) and blur (down), pixels: white none, green "
      "all</title>\n"
      "<rect width=\"100%%\" height=\"100%%\" fill=\"#e8e8e8\"/>\n",
      columns * width, rows * height);
  for (std::size_t i = 0; i < panels.size(); ++i) {
    svg += panelAt(static_cast<int>(i) % columns * width, static_cast<int>(i) / columns * height,
                   panels[i], sides_px, blurs_px);
  }
  return svg + "</svg>\n";
}

}  // namespace waymark::bench
