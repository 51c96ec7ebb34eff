// PDF pages of filled rectangles and text, exact in millimetres.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace waymark::printing {

// On a page, millimetres from its top-left corner: x right, y down.
struct Box {
  double left = 0.0;
  double top = 0.0;
  double width = 0.0;
  double height = 0.0;
};

struct Label {
  double left = 0.0;      // where the text begins, millimetres
  double baseline = 0.0;  // millimetres from the page's top
  double size_mm = 3.0;   // of the font: capitals are 0.72 of it
  std::string text;       // ASCII
};

struct PdfPage {
  double width_mm = 0.0;
  double height_mm = 0.0;
  std::vector<Box> black;  // one shape, so that boxes side by side show no seam
  std::vector<Box> grey;   // what is to be seen by people, but never by a camera
  std::vector<Label> labels;
};

// The whole file, with Helvetica, which every viewer has. It asks viewers not to scale it for the
// paper. Equal pages, equal bytes.
[[nodiscard]] std::string formatPdf(const std::vector<PdfPage>& pages, std::string_view title);

// How wide a text is, millimetres.
[[nodiscard]] double textWidth_mm(std::string_view text, double size_mm);

}  // namespace waymark::printing
