#include "tools/printing/marker_sheets.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

namespace waymark::printing {
namespace {

constexpr double kCutLine_mm = 0.1;
constexpr double kMaxCutMark_mm = 3.0;
constexpr double kTextGap_mm = 0.6;  // below the line of text

// How markers are laid out: tiles side by side, so that one cut separates two.
struct Tiling {
  double side_mm = 0.0;   // of the black square
  double quiet_mm = 0.0;  // white around it
  double text_mm = 0.0;   // size of the line below
  double width_mm = 0.0, height_mm = 0.0;
  int columns = 0, rows = 0;

  [[nodiscard]] std::size_t perPage() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
};

Tiling tilingOf(int cells, const MarkerSheetOptions& options, const PageOptions& page) {
  constexpr double kRounding_mm = 1e-6;
  Tiling t;
  t.side_mm = 1000.0 * options.marker_size_m;
  t.quiet_mm = options.quiet_cells * t.side_mm / cells;
  t.text_mm = std::clamp(0.06 * t.side_mm, 1.6, 4.0);
  t.width_mm = t.side_mm + 2.0 * t.quiet_mm;
  t.height_mm = t.width_mm + t.text_mm + kTextGap_mm;
  const Box area = printableArea(page);
  t.columns = static_cast<int>(std::max(0.0, (area.width + kRounding_mm) / t.width_mm));
  t.rows = static_cast<int>(std::max(0.0, (area.height + kRounding_mm) / t.height_mm));
  return t;
}

// The largest side of which at least one fits on the page, whole millimetres; 0: none.
double largestSide_mm(int cells, MarkerSheetOptions options, const PageOptions& page) {
  PageOptions turned = page;
  turned.paper = page.paper.turned();
  double largest = 0.0;
  for (double side_mm = 1.0; side_mm <= page.paper.height_mm; side_mm += 1.0) {
    options.marker_size_m = 1e-3 * side_mm;
    const bool fits = tilingOf(cells, options, page).perPage() > 0 ||
                      tilingOf(cells, options, turned).perPage() > 0;
    if (fits) largest = side_mm;
  }
  return largest;
}

// What else would take a marker of that side; empty when nothing of these does.
std::string whatWouldHelp(int cells, const MarkerSheetOptions& options) {
  constexpr double kNarrowMargin_mm = 5.0;  // most printers can
  const double wanted_mm = 1000.0 * options.marker_size_m;
  PageOptions page = options.page;
  if (page.margin_mm > kNarrowMargin_mm) {
    page.margin_mm = kNarrowMargin_mm;
    if (largestSide_mm(cells, options, page) >= wanted_mm) {
      return "; --margin " + millimetres(kNarrowMargin_mm) + " would do";
    }
  }
  page.margin_mm = options.page.margin_mm;
  for (const char* larger : {"a4", "a3", "a2", "a1", "a0"}) {
    page.paper = *paperFromText(larger);
    if (largestSide_mm(cells, options, page) >= wanted_mm) {
      return "; --page " + std::string(larger) + " would do";
    }
  }
  return {};
}

// The longest of some texts that fits; the last one is shrunk until it does.
void addCaption(const slam::Dictionary& dictionary, int id, const Tiling& t, double left,
                double baseline, PdfPage* page) {
  const std::string size = millimetres(t.side_mm) + " mm";
  const std::string number = std::to_string(id);
  std::string text;
  for (const std::string& candidate :
       {dictionary.name() + "  id " + number + "  " + size, "id " + number + "  " + size, number}) {
    text = candidate;
    if (textWidth_mm(text, t.text_mm) <= t.side_mm) break;
  }
  const double shrink = std::min(1.0, t.side_mm / textWidth_mm(text, t.text_mm));
  page->labels.push_back({left, baseline, shrink * t.text_mm, text});
}

// A small cross where four tiles meet.
void addCutMark(double x, double y, double arm_mm, PdfPage* page) {
  page->grey.push_back({x - arm_mm, y - 0.5 * kCutLine_mm, 2.0 * arm_mm, kCutLine_mm});
  page->grey.push_back({x - 0.5 * kCutLine_mm, y - arm_mm, kCutLine_mm, 2.0 * arm_mm});
}

void addCutMarks(const Tiling& t, const Box& area, std::size_t markers, PdfPage* page) {
  const double arm_mm = std::min(kMaxCutMark_mm, 0.5 * t.quiet_mm);
  const auto columns = static_cast<std::size_t>(t.columns);
  for (std::size_t row = 0; row <= static_cast<std::size_t>(t.rows); ++row) {
    for (std::size_t column = 0; column <= columns; ++column) {
      const auto there = [&](std::size_t r, std::size_t c) {
        return c < columns && r * columns + c < markers;
      };
      // Does any of the four tiles around exist?
      const bool corner = there(row, column) || (row > 0 && there(row - 1, column)) ||
                          (column > 0 && there(row, column - 1)) ||
                          (row > 0 && column > 0 && there(row - 1, column - 1));
      if (!corner) continue;
      addCutMark(area.left + static_cast<double>(column) * t.width_mm,
                 area.top + static_cast<double>(row) * t.height_mm, arm_mm, page);
    }
  }
}

PdfPage sheet(const slam::Dictionary& dictionary, const std::vector<int>& ids, const Tiling& t,
              const PageOptions& options) {
  PdfPage page = emptyPage(options);
  const Box area = printableArea(options);
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const auto columns = static_cast<std::size_t>(t.columns);
    const double left = area.left + static_cast<double>(i % columns) * t.width_mm + t.quiet_mm;
    const std::size_t row = i / columns;
    const double top = area.top + static_cast<double>(row) * t.height_mm + t.quiet_mm;
    drawMarker(dictionary, ids[i], left, top, t.side_mm, &page.black);
    addCaption(dictionary, ids[i], t, left, top + t.side_mm + t.quiet_mm + 0.72 * t.text_mm, &page);
  }
  addCutMarks(t, area, ids.size(), &page);
  addFooter(options,
            dictionary.name() + ", side of the black square " + millimetres(t.side_mm) + " mm",
            &page);
  return page;
}

}  // namespace

void drawMarker(const slam::Dictionary& dictionary, int id, double left, double top, double side_mm,
                std::vector<Box>* boxes) {
  const int cells = dictionary.cells();
  const double cell_mm = side_mm / cells;
  for (int row = 0; row < cells; ++row) {
    for (int column = 0; column < cells; ++column) {
      if (dictionary.white(id, row, column)) continue;
      int end = column + 1;
      while (end < cells && !dictionary.white(id, row, end)) ++end;
      boxes->push_back(
          {left + column * cell_mm, top + row * cell_mm, (end - column) * cell_mm, cell_mm});
      column = end;
    }
  }
}

Result<std::vector<PdfPage>> markerSheets(const slam::Dictionary& dictionary,
                                          const MarkerSheetOptions& options) {
  for (const int id : options.ids) {
    if (id < 0 || id >= dictionary.size()) {
      return Error{dictionary.name() + " has ids 0 to " + std::to_string(dictionary.size() - 1) +
                   ", not " + std::to_string(id)};
    }
  }
  PageOptions page = options.page;
  Tiling t = tilingOf(dictionary.cells(), options, page);
  if (t.perPage() == 0) {
    page.paper = page.paper.turned();
    t = tilingOf(dictionary.cells(), options, page);
  }
  if (t.perPage() == 0) {
    const Box area = printableArea(options.page);
    return Error{"a marker of " + millimetres(t.side_mm) +
                 " mm with its white border and caption " + "takes " +
                 millimetres(std::ceil(t.width_mm)) + "x" + millimetres(std::ceil(t.height_mm)) +
                 " mm, the page has room for " + millimetres(std::floor(area.width)) + "x" +
                 millimetres(std::floor(area.height)) + ": " +
                 millimetres(largestSide_mm(dictionary.cells(), options, options.page)) +
                 " mm at most" + whatWouldHelp(dictionary.cells(), options)};
  }
  std::vector<PdfPage> pages;
  for (std::size_t first = 0; first < options.ids.size(); first += t.perPage()) {
    const auto begin = options.ids.begin() + static_cast<std::ptrdiff_t>(first);
    const auto count = std::min(t.perPage(), options.ids.size() - first);
    pages.push_back(
        sheet(dictionary, {begin, begin + static_cast<std::ptrdiff_t>(count)}, t, page));
  }
  return pages;
}

}  // namespace waymark::printing
