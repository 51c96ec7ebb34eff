#include "slam/detection/codes/marker_decoder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <utility>

#include "slam/detection/codes/code_likeness.h"
#include "slam/geometry/homography.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Whether all coordinates of p are within 0 .. width and 0 .. height. A quad that is none may put
// it anywhere, where it is no int.
bool isWithin(const Eigen::Vector2f& p, int width, int height) {
  return p.x() >= 0.0F && p.y() >= 0.0F && p.x() < static_cast<float>(width) &&
         p.y() < static_cast<float>(height);
}

// Grey level between pixels. Empty outside the image.
std::optional<float> interpolate(const ImageView& image, const Eigen::Vector2f& p) {
  if (!isWithin(p, image.width - 1, image.height - 1)) return std::nullopt;
  const int x = static_cast<int>(p.x());
  const int y = static_cast<int>(p.y());
  const float fx = p.x() - static_cast<float>(x);
  const float fy = p.y() - static_cast<float>(y);
  const std::uint8_t* const above = image.row(y) + x;
  const std::uint8_t* const below = image.row(y + 1) + x;
  const float top = above[0] + fx * static_cast<float>(above[1] - above[0]);
  const float bottom = below[0] + fx * static_cast<float>(below[1] - below[0]);
  return top + fy * (bottom - top);
}

// How far the lens bends the lines of a print, pixels: between where H and the lens put its middle
// and those of its sides, and where H_px, which has its corners right, puts them.
double bend(const CameraModel& camera, const Eigen::Matrix3d& H, const Eigen::Matrix3d& H_px) {
  double largest = 0.0;
  for (const Eigen::Vector2d& unit :
       {Eigen::Vector2d(0.5, 0.5), Eigen::Vector2d(0.5, 0.0), Eigen::Vector2d(1.0, 0.5),
        Eigen::Vector2d(0.5, 1.0), Eigen::Vector2d(0.0, 0.5)}) {
    const Eigen::Vector2d straight = applyHomography(H_px, unit);
    largest = std::max(largest, (camera.distort(applyHomography(H, unit)) - straight).norm());
  }
  return largest;
}

}  // namespace

std::string MarkerDecoderOptions::invalidReason() const {
  return firstUnmet({
      {max_wrong_bits >= 0, "the number of wrong bits must not be negative"},
      {isShare(max_wrong_border) && isShare(max_wrong_rough_border),
       "the shares of wrong border cells must be from 0 to 1"},
      {isPositive(min_contrast), "the least contrast of a border must be positive"},
      {isShare(min_likeness), "the least likeness of a marker must be from 0 to 1"},
      {isNotNegative(straight_bend), "the bend of a straight print must not be negative"},
      {isPositive(large_cell_px), "the size of a large cell must be positive"},
      {sample_spread >= 0.0 && sample_spread < 0.5,
       "the spread of samples must be from 0 to less than half a cell"},
  });
}

MarkerDecoder::MarkerDecoder(const CameraModel& camera, const Dictionary& dictionary,
                             const MarkerDecoderOptions& options)
    : camera_(camera), dictionary_(dictionary), options_(options) {
  options_.max_wrong_bits = std::min(options_.max_wrong_bits, (dictionary.minDistance() - 1) / 2);
}

bool MarkerDecoder::layOutCells(const Corners& corners) {
  const auto H = homographyFromUnitSquare(corners);
  if (!H) return false;
  Corners pixels;
  for (std::size_t k = 0; k < 4; ++k) pixels[k] = camera_.distort(corners[k]);
  const auto H_px = homographyFromUnitSquare(pixels);
  if (!H_px) return false;
  const int cells = dictionary_.cells();
  const double cell_px =
      std::sqrt((pixels[2] - pixels[0]).norm() * (pixels[3] - pixels[1]).norm()) /
      (std::numbers::sqrt2 * cells);
  large_cells_ = cell_px >= options_.large_cell_px;
  const bool straight = bend(camera_, *H, *H_px) < options_.straight_bend * cell_px;
  centres_.clear();
  for (int row = -1; row <= cells; ++row) {
    for (int column = -1; column <= cells; ++column) {
      const Eigen::Vector2d unit((column + 0.5) / cells, (row + 0.5) / cells);
      const Eigen::Vector2d centre =
          straight ? applyHomography(*H_px, unit) : camera_.distort(applyHomography(*H, unit));
      centres_.push_back(centre.cast<float>());
    }
  }
  return true;
}

// A small cell's middle, between its pixels; the mean of five pixels of a larger one.
float MarkerDecoder::greyOf(const ImageView& image, int row, int column) const {
  const Eigen::Vector2f& middle = centre(row, column);
  if (!large_cells_) return interpolate(image, middle).value_or(-1.0F);
  const auto spread = static_cast<float>(options_.sample_spread);
  const int cells = dictionary_.cells();
  const int left = std::max(column - 1, -1);
  const int right = std::min(column + 1, cells);
  const int over = std::max(row - 1, -1);
  const int under = std::min(row + 1, cells);
  const Eigen::Vector2f across =
      spread / static_cast<float>(right - left) * (centre(row, right) - centre(row, left));
  const Eigen::Vector2f down =
      spread / static_cast<float>(under - over) * (centre(under, column) - centre(over, column));
  const Eigen::Vector2f falling = across + down;
  const Eigen::Vector2f rising = across - down;
  int sum = 0;
  for (const Eigen::Vector2f& point :
       {middle, Eigen::Vector2f(middle - falling), Eigen::Vector2f(middle + rising),
        Eigen::Vector2f(middle - rising), Eigen::Vector2f(middle + falling)}) {
    const Eigen::Vector2f corner = point.array() + 0.5F;
    if (!isWithin(corner, image.width, image.height)) return -1.0F;
    sum += image.at(static_cast<int>(corner.x()), static_cast<int>(corner.y()));
  }
  return 0.2F * static_cast<float>(sum);
}

QuadReading MarkerDecoder::read(const ImageView& image, const Corners& corners) {
  if (!layOutCells(corners)) return {};
  const int last = dictionary_.cells() - 1;
  // Around the border it has to be light. The image may end there.
  float white = 0.0F;
  int around = 0;
  const auto addWhite = [&](float level) {
    if (level < 0.0F) return;
    white += level;
    ++around;
  };
  for (int i = -1; i <= last; ++i) {
    addWhite(greyOf(image, -1, i));
    addWhite(greyOf(image, i, last + 1));
    addWhite(greyOf(image, last + 1, i + 1));
    addWhite(greyOf(image, i + 1, -1));
  }
  if (around == 0) return {};
  white /= static_cast<float>(around);

  float black = 0.0F;
  levels_.resize(static_cast<std::size_t>(dictionary_.cells() * dictionary_.cells()));
  const auto levelOf = [&](int row, int column) -> float& {
    return levels_[static_cast<std::size_t>(row * dictionary_.cells() + column)];
  };
  const auto borderAt = [last](int i) {
    return std::array{std::pair(0, i), std::pair(i, last), std::pair(last, i + 1),
                      std::pair(i + 1, 0)};
  };
  for (int i = 0; i < last; ++i) {
    for (const auto& [row, column] : borderAt(i)) {
      const float level = greyOf(image, row, column);
      if (level < 0.0F) return {};
      levelOf(row, column) = level;
      black += level;
    }
  }
  const int cells = 4 * last;
  black /= static_cast<float>(cells);
  if (white - black < static_cast<float>(options_.min_contrast)) return {};

  const float threshold = 0.5F * (black + white);
  int wrong_border = 0;
  for (int i = 0; i < last; ++i) {
    for (const auto& [row, column] : borderAt(i)) {
      if (levelOf(row, column) > threshold) ++wrong_border;
    }
  }
  const double wrong_share = static_cast<double>(wrong_border) / cells;
  if (wrong_share > options_.max_wrong_rough_border) return {};
  QuadReading reading{QuadContent::kNoCode, {}, {}};
  if (wrong_share > options_.max_wrong_border) return reading;
  std::uint64_t code = 0;
  for (int row = 1; row < last; ++row) {
    for (int column = 1; column < last; ++column) {
      const float level = greyOf(image, row, column);
      if (level < 0.0F) return {};
      levelOf(row, column) = level;
      code = (code << 1U) | (level > threshold ? 1U : 0U);
    }
  }
  reading.code = code;
  if (const auto match = dictionary_.identify(code, options_.max_wrong_bits)) {
    reading.content = QuadContent::kMarker;
    reading.match = *match;
  }
  return reading;
}

double MarkerDecoder::likeness(int id, double variance) const {
  return codeLikeness(dictionary_, id, levels_, variance);
}

}  // namespace waymark::slam
