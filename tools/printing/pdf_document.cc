#include "tools/printing/pdf_document.h"

#include <array>
#include <cstddef>
#include <cstdio>

#include "io/text/number_text.h"

namespace waymark::printing {
namespace {

constexpr double kPointsPerMm = 72.0 / 25.4;
constexpr int kFontObject = 3;
constexpr int kFirstPageObject = 4;

// Advance widths of Helvetica, thousandths of the font's size, from the blank (32) to the tilde.
constexpr std::array<int, 95> kWidths = {
    278,  278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278,  //
    556,  556, 556, 556, 556, 556, 556, 556, 556, 556, 278, 278, 584, 584, 584, 556,  //
    1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833, 722, 778,  //
    667,  778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556,  //
    333,  556, 556, 500, 556, 556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556,  //
    556,  556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584};

// A hundredth of a micrometre.
std::string n(double value) { return io::fixed(value, 5); }

std::string textLiteral(std::string_view text) {
  std::string literal = "(";
  for (const char c : text) {
    if (c == '(' || c == ')' || c == '\\') literal += '\\';
    literal += c >= ' ' && c <= '~' ? c : '?';
  }
  return literal + ")";
}

// Drawing operators; `to_points` has put the origin into the page's lower left corner.
std::string filled(const std::vector<Box>& boxes, double page_height_mm, const char* grey) {
  if (boxes.empty()) return {};
  std::string text = std::string(grey) + " g\n";
  for (const Box& box : boxes) {
    text += n(box.left) + " " + n(page_height_mm - box.top - box.height) + " " + n(box.width) +
            " " + n(box.height) + " re\n";
  }
  return text + "f\n";
}

std::string content(const PdfPage& page) {
  const std::string scale = io::fixed(kPointsPerMm, 10);
  std::string text = scale + " 0 0 " + scale + " 0 0 cm\n";
  text += filled(page.black, page.height_mm, "0");
  text += filled(page.grey, page.height_mm, "0.6");
  text += "0.2 g\n";
  for (const Label& label : page.labels) {
    text += "BT /F1 " + n(label.size_mm) + " Tf " + n(label.left) + " " +
            n(page.height_mm - label.baseline) + " Td " + textLiteral(label.text) + " Tj ET\n";
  }
  return text;
}

std::string pageObject(const PdfPage& page, int content_object) {
  return "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 " + n(page.width_mm * kPointsPerMm) + " " +
         n(page.height_mm * kPointsPerMm) + "] /Resources << /Font << /F1 " +
         std::to_string(kFontObject) + " 0 R >> >> /Contents " + std::to_string(content_object) +
         " 0 R >>";
}

// The numbered objects of a file, and where they lie in it.
class Objects {
 public:
  void add(const std::string& body) {
    offsets_.push_back(text_.size());
    text_ += std::to_string(offsets_.size()) + " 0 obj\n" + body + "\nendobj\n";
  }

  [[nodiscard]] std::string finish(int info_object) && {
    const std::size_t table = text_.size();
    const std::string count = std::to_string(offsets_.size() + 1);
    text_ += "xref\n0 " + count + "\n0000000000 65535 f \n";
    for (const std::size_t offset : offsets_) {
      char line[24];
      std::snprintf(line, sizeof line, "%010zu 00000 n \n", offset);
      text_ += line;
    }
    text_ += "trailer\n<< /Size " + count + " /Root 1 0 R /Info " + std::to_string(info_object) +
             " 0 R >>\nstartxref\n" + std::to_string(table) + "\n%%EOF\n";
    return std::move(text_);
  }

 private:
  std::string text_ = "%PDF-1.7\n";
  std::vector<std::size_t> offsets_;
};

}  // namespace

std::string formatPdf(const std::vector<PdfPage>& pages, std::string_view title) {
  Objects objects;
  objects.add("<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>");
  std::string kids;
  for (std::size_t i = 0; i < pages.size(); ++i) {
    kids += (i == 0 ? "" : " ") + std::to_string(kFirstPageObject + 2 * i) + " 0 R";
  }
  objects.add("<< /Type /Pages /Kids [" + kids + "] /Count " + std::to_string(pages.size()) +
              " >>");
  objects.add("<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>");
  int next = kFirstPageObject;
  for (const PdfPage& page : pages) {
    objects.add(pageObject(page, next + 1));
    const std::string drawn = content(page);
    objects.add("<< /Length " + std::to_string(drawn.size()) + " >>\nstream\n" + drawn +
                "endstream");
    next += 2;
  }
  objects.add("<< /Title " + textLiteral(title) + " /Producer (Waymark) >>");
  return std::move(objects).finish(next);
}

double textWidth_mm(std::string_view text, double size_mm) {
  int thousandths = 0;
  for (const char c : text) {
    thousandths +=
        c >= ' ' && c <= '~' ? kWidths[static_cast<std::size_t>(c - ' ')] : kWidths['?' - ' '];
  }
  return 1e-3 * thousandths * size_mm;
}

}  // namespace waymark::printing
