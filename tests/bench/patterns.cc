#include "tests/bench/patterns.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "tests/bench/develop.h"

namespace waymark::bench {
namespace {

constexpr float kDark = 40.0F;
constexpr float kLight = 200.0F;
constexpr double kNoiseSigma = 2.0;  // of the sensor

bool isOneOf(int in, simulator::Random* random) {
  return random->next() % static_cast<std::uint64_t>(in) == 0;
}

}  // namespace

PatternPicture::PatternPicture(Pattern pattern, int width, int height,
                               const slam::Dictionary& dictionary,
                               std::span<const PlacedMarker> markers, std::uint64_t seed)
    : width_(width + kRoomPx),
      height_(height + kRoomPx),
      image_width_(width),
      image_height_(height),
      light_(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_), kLight) {
  simulator::Random random(seed);
  paint(pattern, &random);
  for (const PlacedMarker& marker : markers) paintMarker(dictionary, marker);
  develop(light_, width_, height_, kNoiseSigma, &random, &pixels_);
}

ImageView PatternPicture::from(int left, int top) const {
  return {pixels_.data() + static_cast<std::ptrdiff_t>(top) * width_ + left, image_width_,
          image_height_, width_};
}

template <typename Level>
void PatternPicture::fill(int left, int top, int width, int height, const Level& level) {
  for (int y = std::max(top, 0); y < std::min(top + height, height_); ++y) {
    for (int x = std::max(left, 0); x < std::min(left + width, width_); ++x) {
      float& light = light_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                            static_cast<std::size_t>(x)];
      light = level(x, y, light);
    }
  }
}

void PatternPicture::paint(Pattern pattern, simulator::Random* random) {
  switch (pattern) {
    case Pattern::kNone:
      break;
    case Pattern::kSquares:
      fill(0, 0, width_, height_,
           [](int x, int y, float) { return x % 10 < 8 && y % 10 < 8 ? kDark : kLight; });
      break;
    case Pattern::kDiscs:
      fill(0, 0, width_, height_, [](int x, int y, float) {
        return std::hypot(x % 11 - 5, y % 11 - 5) < 4.2 ? kDark : kLight;
      });
      break;
    case Pattern::kWindows:
      paintWindows(random);
      break;
    case Pattern::kText:
      paintText(random);
      break;
    case Pattern::kFoliage:
      paintFoliage(random);
      break;
    case Pattern::kNoise:
      fill(0, 0, width_, height_,
           [random](int, int, float) { return static_cast<float>(random->uniform(0.0, 255.0)); });
      break;
  }
}

void PatternPicture::paintWindows(simulator::Random* random) {
  for (int top = 6; top < height_; top += 48) {
    for (int left = 6; left < width_; left += 36) {
      fill(left, top, 24, 36, [](int, int, float) { return kDark; });
      const auto bar = [](int, int, float) { return kLight - 20.0F; };
      if (isOneOf(3, random)) fill(left + 11, top + 3, 2, 30, bar);
      if (isOneOf(3, random)) fill(left + 3, top + 12, 18, 2, bar);
      if (isOneOf(4, random))
        fill(left + 4, top + 4, 16, 6 + 2 * static_cast<int>(random->next() % 8), bar);
    }
  }
}

// Letters of three by five dots.
void PatternPicture::paintText(simulator::Random* random) {
  for (int top = 4; top < height_; top += 22) {
    for (int left = 4; left < width_; left += 12) {
      if (isOneOf(6, random)) continue;  // between words
      for (int dot = 0; dot < 15; ++dot) {
        if (isOneOf(3, random)) continue;
        fill(left + dot % 3 * 3, top + dot / 3 * 3, 3, 3, [](int, int, float) { return kDark; });
      }
    }
  }
}

void PatternPicture::paintFoliage(simulator::Random* random) {
  const int leaves = width_ * height_ / 40;
  for (int leaf = 0; leaf < leaves; ++leaf) {
    const double x0 = random->uniform(0.0, width_);
    const double y0 = random->uniform(0.0, height_);
    const double half = 0.5 * random->uniform(5.0, 20.0);
    const double turn = random->uniform(0.0, std::numbers::pi);
    const auto level = static_cast<float>(random->uniform(20.0, 200.0));
    const int reach = static_cast<int>(half) + 1;
    fill(static_cast<int>(x0) - reach, static_cast<int>(y0) - reach, 2 * reach + 1, 2 * reach + 1,
         [&](int x, int y, float light) {
           const double along = std::cos(turn) * (x - x0) + std::sin(turn) * (y - y0);
           const double across = std::cos(turn) * (y - y0) - std::sin(turn) * (x - x0);
           return std::hypot(along / half, 2.5 * across / half) < 1.0 ? level : light;
         });
  }
}

void PatternPicture::paintMarker(const slam::Dictionary& dictionary, const PlacedMarker& marker) {
  const int cells = dictionary.cells();
  const int margin = marker.cell_px;
  const int side = cells * marker.cell_px;
  fill(marker.left - margin, marker.top - margin, side + 2 * margin, side + 2 * margin,
       [](int, int, float) { return kLight; });
  fill(marker.left, marker.top, side, side, [&](int x, int y, float) {
    const int row = (y - marker.top) / marker.cell_px;
    const int column = (x - marker.left) / marker.cell_px;
    return dictionary.white(marker.id, row, column) ? kLight : kDark;
  });
}

}  // namespace waymark::bench
