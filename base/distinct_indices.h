// Sorted sets of indices, from lists that name few of them and each very often: what was named
// before is left out, and the rest is sorted.
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace waymark {

class DistinctIndices {
 public:
  // For indices from 0 up to this one, which is not among them.
  explicit DistinctIndices(std::size_t end) : named_in_(end, 0) {}

  void sort(std::vector<int>* indices) {
    ++list_;
    std::erase_if(*indices, [&](int index) {
      return std::exchange(named_in_[static_cast<std::size_t>(index)], list_) == list_;
    });
    std::ranges::sort(*indices);
  }

 private:
  std::vector<int> named_in_;  // by index: the last list that named it
  int list_ = 0;
};

}  // namespace waymark
