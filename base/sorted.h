// Vectors as sets.
#pragma once

#include <algorithm>
#include <vector>

namespace waymark {

template <typename T>
void sortUnique(std::vector<T>* values) {
  std::sort(values->begin(), values->end());
  values->erase(std::unique(values->begin(), values->end()), values->end());
}

}  // namespace waymark
