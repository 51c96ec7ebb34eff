#include "tools/printing/paper.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <utility>

#include "io/text/number_text.h"

namespace waymark::printing {
namespace {

constexpr std::array<std::pair<std::string_view, Paper>, 10> kPapers = {
    {{"a0", {841.0, 1189.0}},
     {"a1", {594.0, 841.0}},
     {"a2", {420.0, 594.0}},
     {"a3", {297.0, 420.0}},
     {"a4", {210.0, 297.0}},
     {"a5", {148.0, 210.0}},
     {"a6", {105.0, 148.0}},
     {"letter", {215.9, 279.4}},
     {"legal", {215.9, 355.6}},
     {"tabloid", {279.4, 431.8}}}};
constexpr double kSmallest_mm = 20.0;
constexpr double kLargest_mm = 5000.0;  // of what PDF viewers take
constexpr double kLine_mm = 0.15;
constexpr double kTextSize_mm = 3.0;

void addRuler(double left, double baseline, int length_mm, PdfPage* page) {
  const auto line = [&](double x, double height) {
    page->black.push_back({x - 0.5 * kLine_mm, baseline - height, kLine_mm, height});
  };
  for (int mm = 0; mm <= length_mm; ++mm) {
    line(left + mm, mm % 10 == 0 ? 4.0 : (mm % 5 == 0 ? 3.0 : 2.0));
  }
  page->black.push_back(
      {left - 0.5 * kLine_mm, baseline - kLine_mm, length_mm + kLine_mm, kLine_mm});
}

}  // namespace

std::optional<Paper> paperFromText(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  for (const auto& [name, paper] : kPapers) {
    if (lower == name) return paper;
  }
  const std::size_t cross = lower.find('x');
  if (cross == std::string::npos) return std::nullopt;
  const auto width = io::parseDouble(std::string_view(lower).substr(0, cross));
  const auto height = io::parseDouble(std::string_view(lower).substr(cross + 1));
  for (const auto& side : {width, height}) {
    if (!side || *side < kSmallest_mm || *side > kLargest_mm) return std::nullopt;
  }
  return Paper{*width, *height};
}

Box printableArea(const PageOptions& options) {
  const double margin = options.margin_mm;
  return {margin, margin, options.paper.width_mm - 2.0 * margin,
          options.paper.height_mm - 2.0 * margin - kFooterHeight_mm};
}

PdfPage emptyPage(const PageOptions& options) {
  return {options.paper.width_mm, options.paper.height_mm, {}, {}, {}};
}

void addFooter(const PageOptions& options, std::string_view text, PdfPage* page) {
  const Box area = printableArea(options);
  const double bottom = area.top + area.height + kFooterHeight_mm;
  const double wanted_mm = textWidth_mm(text, kTextSize_mm);
  const double size_mm = kTextSize_mm * std::min(1.0, area.width / std::max(wanted_mm, 1e-3));
  page->labels.push_back({area.left, bottom - 7.0, size_mm, std::string(text)});

  constexpr std::array<int, 3> kLengths = {100, 50, 20};  // mm
  const auto fits = [&](int length) { return length + kLine_mm <= area.width; };
  const auto length = std::find_if(kLengths.begin(), kLengths.end(), fits);
  if (length == kLengths.end()) return;
  addRuler(area.left, bottom, *length, page);
  const std::string what = std::to_string(*length) + " mm";
  const std::string advice = what + " if printed at 100 %, without \"fit to page\"";
  const double room_mm = area.width - *length - 3.0;
  for (const std::string& said : {advice, what}) {
    if (textWidth_mm(said, kTextSize_mm) > room_mm) continue;
    page->labels.push_back({area.left + *length + 3.0, bottom, kTextSize_mm, said});
    break;
  }
}

std::string millimetres(double value_mm) {
  std::string text = io::fixed(value_mm, 3);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

}  // namespace waymark::printing
