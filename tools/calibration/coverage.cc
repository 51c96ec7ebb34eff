#include "tools/calibration/coverage.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <string_view>

namespace waymark::calibration {

void Coverage::add(const Eigen::Vector2d& pixel) {
  ++counts_[static_cast<std::size_t>(grid_.cellOf(pixel))];
}

double Coverage::share() const {
  const auto covered =
      std::count_if(counts_.begin(), counts_.end(), [](int count) { return count > 0; });
  return static_cast<double>(covered) / static_cast<double>(counts_.size());
}

std::string Coverage::missing() const {
  constexpr std::array<std::string_view, 9> kNames = {"top left",    "top",    "top right",
                                                      "left",        "middle", "right",
                                                      "bottom left", "bottom", "bottom right"};
  std::array<int, 9> covered{};
  std::array<int, 9> cells{};
  for (int row = 0; row < grid_.rows; ++row) {
    for (int column = 0; column < grid_.columns; ++column) {
      const int place = 3 * row / grid_.rows * 3 + 3 * column / grid_.columns;
      const auto ninth = static_cast<std::size_t>(place);
      const int cell = row * grid_.columns + column;
      ++cells[ninth];
      if (counts_[static_cast<std::size_t>(cell)] > 0) ++covered[ninth];
    }
  }
  std::string names;
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (3 * covered[i] >= cells[i]) continue;
    names += names.empty() ? "" : ", ";
    names += kNames[i];
  }
  return names;
}

}  // namespace waymark::calibration
