// A borrowed view of an 8-bit grey image. Whoever hands one out keeps the pixels alive.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace waymark {

// Row-major, `stride` bytes from one row to the next (stride >= width). Pixel (0, 0) is the
// top-left one, and integer coordinates are pixel CENTRES everywhere in this project.
struct ImageView {
  const std::uint8_t* data = nullptr;
  int width = 0;
  int height = 0;
  std::ptrdiff_t stride = 0;

  [[nodiscard]] bool empty() const { return data == nullptr || width <= 0 || height <= 0; }
  [[nodiscard]] const std::uint8_t* row(int y) const { return data + y * stride; }
  [[nodiscard]] std::uint8_t at(int x, int y) const { return row(y)[x]; }
};

// "640x480", for messages.
[[nodiscard]] inline std::string sizeText(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

}  // namespace waymark
