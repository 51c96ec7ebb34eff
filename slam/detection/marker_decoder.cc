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

std::optional<Dictionary::Match> MarkerDecoder::decode(
    const ImageView& image, const std::array<Eigen::Vector2d, 4>& corners, double black,
    double white) const {
  const auto H = homographyFromUnitSquare(corners);
  if (!H) return std::nullopt;
  const int cells = dictionary_.cells();
  const double threshold = 0.5 * (black + white);
  const int allowed_border = static_cast<int>(options_.max_wrong_border * 4.0 * (cells - 1));

  // Five points around each cell's centre.
  constexpr double kSpread = 0.18;  // cells
  constexpr std::array<std::array<double, 2>, 5> kPattern = {
      {{0, 0}, {-kSpread, -kSpread}, {kSpread, -kSpread}, {-kSpread, kSpread}, {kSpread, kSpread}}};
  int wrong_border = 0;
  std::uint64_t code = 0;
  for (int row = 0; row < cells; ++row) {
    for (int column = 0; column < cells; ++column) {
      double sum = 0.0;
      for (const auto& offset : kPattern) {
        const Eigen::Vector2d unit((column + 0.5 + offset[0]) / cells,
                                   (row + 0.5 + offset[1]) / cells);
        const double grey = interpolate(image, camera_.distort(applyHomography(*H, unit)));
        if (grey < 0.0) return std::nullopt;
        sum += grey;
      }
      const bool is_white = sum > threshold * kPattern.size();
      const bool border = row == 0 || column == 0 || row == cells - 1 || column == cells - 1;
      if (border) {
        wrong_border += is_white ? 1 : 0;
        if (wrong_border > allowed_border) return std::nullopt;
      } else {
        code = (code << 1) | (is_white ? 1U : 0U);
      }
    }
  }
  return dictionary_.identify(code, options_.max_wrong_bits);
}

}  // namespace waymark::slam
