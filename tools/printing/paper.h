// Paper, and what every printed page has: a ruler and a line of text.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "tools/printing/pdf_document.h"

namespace waymark::printing {

struct Paper {
  double width_mm = 210.0;
  double height_mm = 297.0;

  [[nodiscard]] Paper turned() const { return {height_mm, width_mm}; }
};

// "a4", "a3", ..., "letter", "legal", "tabloid", in any case, upright; or "WIDTHxHEIGHT" in
// millimetres, 20 to 5000 each. Empty for anything else.
[[nodiscard]] std::optional<Paper> paperFromText(std::string_view text);

struct PageOptions {
  Paper paper;
  // Left white on all sides, millimetres: most printers cannot print nearer to the edge.
  double margin_mm = 10.0;
};

// Height that addFooter() takes at the lower margin, millimetres.
inline constexpr double kFooterHeight_mm = 14.0;

// What is left for drawing on, between the margins and above the footer.
[[nodiscard]] Box printableArea(const PageOptions& options);

[[nodiscard]] PdfPage emptyPage(const PageOptions& options);

// A ruler of exactly 100 mm (50 or 20 on small paper, none where that does not fit), ticks every
// millimetre, that shows whether the printer has scaled the page; and `text` above it, shrunk to
// the page's width.
void addFooter(const PageOptions& options, std::string_view text, PdfPage* page);

// 100.0 is "100", 12.5 "12.5".
[[nodiscard]] std::string millimetres(double value_mm);

}  // namespace waymark::printing
