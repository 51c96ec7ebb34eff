// What options may be: each options struct checks its own fields (invalidReason()).
#pragma once

#include <cmath>
#include <initializer_list>
#include <string>
#include <string_view>

namespace waymark::slam {

[[nodiscard]] inline bool isPositive(double value) { return std::isfinite(value) && value > 0.0; }
[[nodiscard]] inline bool isNotNegative(double value) {
  return std::isfinite(value) && value >= 0.0;
}
[[nodiscard]] inline bool isShare(double value) { return value >= 0.0 && value <= 1.0; }

struct Requirement {
  bool met;
  std::string_view otherwise;  // for people
};

// Of the first that is not met; empty when all are.
[[nodiscard]] inline std::string firstUnmet(std::initializer_list<Requirement> requirements) {
  for (const Requirement& requirement : requirements) {
    if (!requirement.met) return std::string(requirement.otherwise);
  }
  return {};
}

// The first that is one; empty when there is none.
[[nodiscard]] inline std::string firstReason(std::initializer_list<std::string> reasons) {
  for (const std::string& reason : reasons) {
    if (!reason.empty()) return reason;
  }
  return {};
}

}  // namespace waymark::slam
