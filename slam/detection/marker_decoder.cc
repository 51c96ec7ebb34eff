#include "slam/detection/marker_decoder.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "slam/geometry/homography.h"

namespace waymark::slam {
namespace {

// Grey level between pixels; negative outside the image.
double interpolate(const ImageView& image, const Eigen::Vector2d& p) {
  const int x = static_cast<int>(std::floor(p.x()));
  const int y = static_cast<int>(std::floor(p.y()));
  if (x < 0 || y < 0 || x + 1 >= image.width || y + 1 >= image.height) return -1.0;
  const double fx = p.x() - x;
  const double fy = p.y() - y;
  const double top = image.at(x, y) + fx * (image.at(x + 1, y) - image.at(x, y));
  const double bottom = image.at(x, y + 1) + fx * (image.at(x + 1, y + 1) - image.at(x, y + 1));
  return top + fy * (bottom - top);
}

}  // namespace

MarkerDecoder::MarkerDecoder(const CameraModel& camera, const Dictionary& dictionary,
                             const MarkerDecoderOptions& options)
    : camera_(camera), dictionary_(dictionary), options_(options) {
  options_.max_wrong_bits = std::min(options_.max_wrong_bits, (dictionary.minDistance() - 1) / 2);
}

bool MarkerDecoder::sampleCells(const ImageView& image,
                                const std::array<Eigen::Vector2d, 4>& corners) {
  const auto H = homographyFromUnitSquare(corners);
  if (!H) return false;
  const int cells = dictionary_.cells();
  const int side = cells + 2;
  centres_.clear();
  for (int row = -1; row <= cells; ++row) {
    for (int column = -1; column <= cells; ++column) {
      const Eigen::Vector2d unit((column + 0.5) / cells, (row + 0.5) / cells);
      centres_.push_back(camera_.distort(applyHomography(*H, unit)));
    }
  }
  // Five points around each cell's centre, by the distances to its neighbours.
  constexpr double kSpread = 0.18;  // cells
  grey_.clear();
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      const auto centre = [&](int r, int c) -> const Eigen::Vector2d& {
        const int index = r * side + c;
        return centres_[static_cast<std::size_t>(index)];
      };
      const int left = std::max(column - 1, 0);
      const int right = std::min(column + 1, side - 1);
      const int over = std::max(row - 1, 0);
      const int under = std::min(row + 1, side - 1);
      const Eigen::Vector2d across =
          kSpread / (right - left) * (centre(row, right) - centre(row, left));
      const Eigen::Vector2d down =
          kSpread / (under - over) * (centre(under, column) - centre(over, column));
      const Eigen::Vector2d& middle = centre(row, column);
      double sum = 0.0;
      for (const Eigen::Vector2d& point :
           {middle, Eigen::Vector2d(middle - across - down),
            Eigen::Vector2d(middle + across - down), Eigen::Vector2d(middle - across + down),
            Eigen::Vector2d(middle + across + down)}) {
        const double level = interpolate(image, point);
        const bool in_ring = row == 0 || column == 0 || row == side - 1 || column == side - 1;
        if (level < 0.0 && !in_ring) return false;
        sum += level < 0.0 ? -1e6 : level;
      }
      grey_.push_back(sum / 5.0);  // far below zero where the ring leaves the image
    }
  }
  return true;
}

QuadReading MarkerDecoder::read(const ImageView& image,
                                const std::array<Eigen::Vector2d, 4>& corners) {
  if (!sampleCells(image, corners)) return {};
  const int last = dictionary_.cells() - 1;
  double black = 0.0;
  double white = 0.0;
  int around = 0;
  for (int i = -1; i <= last + 1; ++i) {
    for (const double level : {grey(-1, i), grey(last + 1, i), grey(i, -1), grey(i, last + 1)}) {
      if (level < 0.0) continue;
      white += level;
      ++around;
    }
  }
  for (int i = 0; i < last; ++i) {
    black += grey(0, i) + grey(i, last) + grey(last, i + 1) + grey(i + 1, 0);
  }
  const int border = 4 * last;
  if (around == 0) return {};
  white /= around;
  black /= border;
  if (white - black < options_.min_contrast) return {};

  const double threshold = 0.5 * (black + white);
  int wrong_border = 0;
  std::uint64_t code = 0;
  for (int row = 0; row <= last; ++row) {
    for (int column = 0; column <= last; ++column) {
      const bool is_white = grey(row, column) > threshold;
      if (row == 0 || column == 0 || row == last || column == last) {
        wrong_border += is_white ? 1 : 0;
      } else {
        code = (code << 1U) | (is_white ? 1U : 0U);
      }
    }
  }
  if (wrong_border > options_.max_wrong_rough_border * border) return {};
  QuadReading reading{QuadContent::kNoCode, {}};
  if (wrong_border > options_.max_wrong_border * border) return reading;
  if (const auto match = dictionary_.identify(code, options_.max_wrong_bits)) {
    reading = {QuadContent::kMarker, *match};
  }
  return reading;
}

}  // namespace waymark::slam
