// A grey picture that a test paints.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/image_view.h"

namespace waymark::slam::testing {

class Picture {
 public:
  Picture(int width, int height, std::uint8_t grey)
      : width_(width),
        height_(height),
        pixels_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), grey) {}

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] std::uint8_t& at(int x, int y) { return pixels_[index(x, y)]; }
  [[nodiscard]] std::uint8_t at(int x, int y) const { return pixels_[index(x, y)]; }
  // Valid while the picture is.
  [[nodiscard]] ImageView view() const { return {pixels_.data(), width_, height_, width_}; }

  // Paints where `inside` says so of a pixel's x and y.
  template <typename Inside>
  void paint(std::uint8_t grey, const Inside& inside) {
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) {
        if (inside(x, y)) at(x, y) = grey;
      }
    }
  }

 private:
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(x);
  }

  int width_;
  int height_;
  std::vector<std::uint8_t> pixels_;
};

}  // namespace waymark::slam::testing
