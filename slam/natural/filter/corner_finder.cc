#include "slam/natural/filter/corner_finder.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "base/vectorized.h"

namespace waymark::slam {
namespace {

constexpr int kWindow = 7;  // pixels that a corner's gradients are summed over, each way
constexpr int kReach = kWindow / 2;

WAYMARK_VECTORIZED void gradientRow(const std::uint8_t* above, const std::uint8_t* row,
                                    const std::uint8_t* below, int count, float* xx, float* xy,
                                    float* yy) {
  for (int x = 0; x < count; ++x) {
    const float gx = 0.5F * static_cast<float>(row[x + 1] - row[x - 1]);
    const float gy = 0.5F * static_cast<float>(below[x] - above[x]);
    xx[x] = gx * gx;
    xy[x] = gx * gy;
    yy[x] = gy * gy;
  }
}

WAYMARK_VECTORIZED void sumAlong(const float* in, int count, float* out) {
  for (int x = 0; x < count; ++x) {
    out[x] = in[x] + in[x + 1] + in[x + 2] + in[x + 3] + in[x + 4] + in[x + 5] + in[x + 6];
  }
}

WAYMARK_VECTORIZED void sumAcross(const float* in, int stride, int count, float* out) {
  for (int x = 0; x < count; ++x) {
    out[x] = in[x] + in[x + stride] + in[x + 2 * stride] + in[x + 3 * stride] + in[x + 4 * stride] +
             in[x + 5 * stride] + in[x + 6 * stride];
  }
}

WAYMARK_VECTORIZED void smallerEigenvalues(const float* xx, const float* xy, const float* yy,
                                           int count, float* out) {
  for (int x = 0; x < count; ++x) {
    const float half = 0.5F * (xx[x] - yy[x]);
    out[x] = 0.5F * (xx[x] + yy[x]) - std::sqrt(half * half + xy[x] * xy[x]);
  }
}

}  // namespace

FoundCorner CornerFinder::best(const ImageView& image, int left, int top, int right, int bottom,
                               int margin_px) {
  const int margin = std::max(margin_px, kReach + 1);
  left = std::max(left, margin);
  top = std::max(top, margin);
  right = std::min(right, image.width - margin);
  bottom = std::min(bottom, image.height - margin);
  FoundCorner found;
  const int width = right - left;
  const int height = bottom - top;
  if (width <= 0 || height <= 0) return found;
  const int columns = width + 2 * kReach;
  const int rows = height + 2 * kReach;
  const auto size = static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  for (auto* buffer : {&xx_, &xy_, &yy_, &sxx_, &sxy_, &syy_}) {
    if (buffer->size() < size) buffer->resize(size);
  }
  for (int r = 0; r < rows; ++r) {
    const int y = top - kReach + r;
    const int x = left - kReach;
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(r) * columns;
    gradientRow(image.row(y - 1) + x, image.row(y) + x, image.row(y + 1) + x, columns,
                xx_.data() + at, xy_.data() + at, yy_.data() + at);
    sumAlong(xx_.data() + at, width, sxx_.data() + at);
    sumAlong(xy_.data() + at, width, sxy_.data() + at);
    sumAlong(yy_.data() + at, width, syy_.data() + at);
  }
  constexpr float kPerPixel = 1.0F / (kWindow * kWindow);
  for (int r = 0; r < height; ++r) {
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(r) * columns;
    sumAcross(sxx_.data() + at, columns, width, xx_.data());
    sumAcross(sxy_.data() + at, columns, width, xy_.data());
    sumAcross(syy_.data() + at, columns, width, yy_.data());
    smallerEigenvalues(xx_.data(), xy_.data(), yy_.data(), width, xx_.data());
    const auto top_score = std::max_element(xx_.begin(), xx_.begin() + width);
    if (!(kPerPixel * *top_score > found.score)) continue;
    found = {left + static_cast<int>(top_score - xx_.begin()), top + r, kPerPixel * *top_score};
  }
  return found;
}

}  // namespace waymark::slam
