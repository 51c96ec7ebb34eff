#include "tests/bench/develop.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace waymark::bench {

void develop(const std::vector<float>& light, int width, int height, double noise_sigma,
             simulator::Random* random, std::vector<std::uint8_t>* pixels) {
  const auto at = [&](int x, int y) -> float {
    return light[static_cast<std::size_t>(std::clamp(y, 0, height - 1)) *
                     static_cast<std::size_t>(width) +
                 static_cast<std::size_t>(std::clamp(x, 0, width - 1))];
  };
  // Numbers drawn once and used from a random place on: gaussian ones are dear.
  std::array<float, 4096> noise{};
  for (float& value : noise) value = static_cast<float>(noise_sigma * random->gaussian());
  pixels->resize(light.size());
  std::size_t i = 0;
  for (int y = 0; y < height; ++y) {
    std::size_t place = random->next() % noise.size();
    for (int x = 0; x < width; ++x) {
      float sum = 0.0F;
      for (int dy = -1; dy <= 1; ++dy) sum += at(x - 1, y + dy) + at(x, y + dy) + at(x + 1, y + dy);
      place = (place + 1) % noise.size();
      (*pixels)[i++] =
          static_cast<std::uint8_t>(std::clamp(std::lround(sum / 9.0F + noise[place]), 0L, 255L));
    }
  }
}

}  // namespace waymark::bench
