// What fills an image with dark things without end, and markers in front of it.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "base/image_view.h"
#include "simulator/random.h"
#include "slam/detection/codes/dictionary.h"

namespace waymark::bench {

enum class Pattern : std::uint8_t { kNone, kSquares, kDiscs, kWindows, kText, kFoliage, kNoise };

struct NamedPattern {
  Pattern pattern;
  std::string_view name;
};

inline constexpr std::array kPatterns = {
    NamedPattern{Pattern::kNone, "none"},        // a light wall, to compare with
    NamedPattern{Pattern::kSquares, "squares"},  // a perforated panel: 8 px every 10
    NamedPattern{Pattern::kDiscs, "discs"},      // a loudspeaker's grille: 8 px every 11
    NamedPattern{Pattern::kWindows, "windows"},  // a facade: 24 x 36 px, some with bars or blinds
    NamedPattern{Pattern::kText, "text"},        // 14 px high
    NamedPattern{Pattern::kFoliage, "foliage"},  // leaves of 5 to 20 px over each other
    NamedPattern{Pattern::kNoise, "noise"},      // each pixel has a grey level of its own
};

// Upright, with a light margin.
struct PlacedMarker {
  int id = 0;
  int left = 0;  // of the border, pixels
  int top = 0;
  int cell_px = 1;
};

// A picture larger than the image, so that the image may move over it.
class PatternPicture {
 public:
  static constexpr int kRoomPx = 48;  // to the right and below

  PatternPicture(Pattern pattern, int width, int height, const slam::Dictionary& dictionary,
                 std::span<const PlacedMarker> markers, std::uint64_t seed);

  // Its part from (left, top) on, at most kRoomPx each. Valid while the picture is.
  [[nodiscard]] ImageView from(int left, int top) const;

 private:
  void paint(Pattern pattern, simulator::Random* random);
  void paintWindows(simulator::Random* random);
  void paintText(simulator::Random* random);
  void paintFoliage(simulator::Random* random);
  void paintMarker(const slam::Dictionary& dictionary, const PlacedMarker& marker);
  // level(x, y) within the rectangle, as far as it is in the picture.
  template <typename Level>
  void fill(int left, int top, int width, int height, const Level& level);

  int width_;
  int height_;
  int image_width_;
  int image_height_;
  std::vector<float> light_;
  std::vector<std::uint8_t> pixels_;
};

}  // namespace waymark::bench
