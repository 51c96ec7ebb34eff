// Order statistics of what was measured: latencies, times.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

namespace waymark {

// The quantile by nearest rank, so always a value that was measured: of n samples the one with
// ceil(n thousandths / 1000) - 1 before it. Thousandths keep the rank exact: 500 is the median.
// Precondition: `sorted` is, and is not empty; 0 < thousandths <= 1000.
template <typename T>
[[nodiscard]] T quantile(std::span<const T> sorted, std::size_t thousandths) {
  return sorted[(sorted.size() * thousandths + 999) / 1000 - 1];
}

// What is said of latencies; zeros when there are no samples.
struct TimeQuantiles {
  std::int64_t median = 0;
  std::int64_t p99 = 0;
  std::int64_t max = 0;
};
// Sorts `samples`.
[[nodiscard]] inline TimeQuantiles timeQuantiles(std::span<std::int64_t> samples) {
  if (samples.empty()) return {};
  std::ranges::sort(samples);
  const std::span<const std::int64_t> sorted = samples;
  return {quantile(sorted, 500), quantile(sorted, 990), sorted.back()};
}

}  // namespace waymark
