#include "tools/diagnosis/image_quality.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>

#include "base/quantile.h"
#include "io/text/number_text.h"

namespace waymark::diagnosis {
namespace {

constexpr int kTile_px = 32;
// Of a tile, before its edges say something: below it noise would look like an edge.
constexpr int kMinTileContrast = 60;

using Histogram = std::array<std::size_t, 256>;

int levelAt(const Histogram& histogram, std::size_t rank) {
  std::size_t below = 0;
  for (std::size_t level = 0; level < histogram.size(); ++level) {
    below += histogram[level];
    if (below > rank) return static_cast<int>(level);
  }
  return 255;
}

// Contrast over the steepest slope. Empty where there is too little contrast.
std::optional<double> edgeWidthIn(const ImageView& image, int left, int top) {
  int darkest = 255;
  int brightest = 0;
  int twice_slope = 0;
  for (int y = top; y < top + kTile_px; ++y) {
    const std::uint8_t* row = image.row(y);
    for (int x = left; x < left + kTile_px; ++x) {
      darkest = std::min<int>(darkest, row[x]);
      brightest = std::max<int>(brightest, row[x]);
      const int across = std::abs(row[x + 1] - row[x - 1]);
      const int down = std::abs(image.row(y + 1)[x] - image.row(y - 1)[x]);
      twice_slope = std::max({twice_slope, across, down});
    }
  }
  const int contrast = brightest - darkest;
  if (contrast < kMinTileContrast || twice_slope == 0) return std::nullopt;
  return 2.0 * contrast / twice_slope;
}

template <typename T>
T medianOf(std::vector<T> values) {
  if (values.empty()) return T{};
  std::ranges::sort(values);
  return quantile(std::span<const T>(values), 500);
}

}  // namespace

ImageQuality measureQuality(const ImageView& image) {
  ImageQuality quality;
  if (image.empty()) return quality;
  Histogram histogram{};
  for (int y = 0; y < image.height; ++y) {
    const std::uint8_t* row = image.row(y);
    for (int x = 0; x < image.width; ++x) ++histogram[row[x]];
  }
  const std::size_t all =
      static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  quality.dark = levelAt(histogram, all / 100);
  quality.median = levelAt(histogram, all / 2);
  quality.bright = levelAt(histogram, all - 1 - all / 100);
  std::size_t saturated = 0;
  for (std::size_t level = 250; level < histogram.size(); ++level) saturated += histogram[level];
  quality.saturated = static_cast<double>(saturated) / static_cast<double>(all);

  std::vector<double> widths;
  for (int y = 1; y + kTile_px < image.height; y += kTile_px) {
    for (int x = 1; x + kTile_px < image.width; x += kTile_px) {
      if (const auto width = edgeWidthIn(image, x, y)) widths.push_back(*width);
    }
  }
  if (!widths.empty()) {
    std::ranges::sort(widths);
    quality.edge_width_px = quantile(std::span<const double>(widths), 100);
  }
  return quality;
}

ImageQuality medianQuality(std::span<const GreyImage> images) {
  std::vector<int> dark, median, bright;
  std::vector<double> saturated, widths;
  for (const GreyImage& image : images) {
    const ImageQuality one = measureQuality(image.view());
    dark.push_back(one.dark);
    median.push_back(one.median);
    bright.push_back(one.bright);
    saturated.push_back(one.saturated);
    if (one.edge_width_px > 0.0) widths.push_back(one.edge_width_px);
  }
  return {medianOf(dark), medianOf(median), medianOf(bright), medianOf(saturated),
          medianOf(widths)};
}

std::vector<std::string> qualityAdvice(const ImageQuality& quality, const QualityLimits& limits) {
  std::vector<std::string> advice;
  if (quality.bright < limits.dark_below) {
    advice.push_back("the images are dark (99 % of a picture is below " +
                     std::to_string(quality.bright) +
                     " of 255): more light, more gain, or a longer exposure");
  }
  if (quality.saturated > limits.saturated_above) {
    advice.push_back("the images are overexposed (" + io::fixed(100.0 * quality.saturated, 0) +
                     " % of a picture is white): a shorter exposure or less gain");
  }
  const int contrast = quality.bright - quality.dark;
  if (contrast < limits.flat_below && quality.bright >= limits.dark_below) {
    advice.push_back("the images show nothing (" + std::to_string(contrast) +
                     " grey levels from their dark to their bright parts): is something before "
                     "the lens?");
  }
  if (quality.edge_width_px > limits.wide_edges_px) {
    advice.push_back("nothing in the images is sharp (the sharpest edges are " +
                     io::fixed(quality.edge_width_px, 0) +
                     " pixels wide): focus the lens, or a shorter exposure while the camera moves");
  }
  return advice;
}

}  // namespace waymark::diagnosis
