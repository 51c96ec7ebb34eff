#include "slam/covariance/marginals.h"

#include <algorithm>

namespace waymark::slam {

const Matrix6d* MapMarginals::find(int marker) const {
  const auto found = own_.find(marker);
  return found == own_.end() ? nullptr : &found->second;
}

const Matrix6d* MapMarginals::findBetween(int a, int b) const {
  const std::pair<int, int> pair(std::max(a, b), std::min(a, b));
  const auto found = std::ranges::lower_bound(pairs_, pair);
  if (found == pairs_.end() || *found != pair) return nullptr;
  return &between_[static_cast<std::size_t>(found - pairs_.begin())];
}

const PoseGlobalMatrix* MapMarginals::byCamera(int marker) const {
  const auto found = by_camera_.find(marker);
  return found == by_camera_.end() ? nullptr : &found->second;
}

std::optional<Matrix6d> MapMarginals::between(int a, int b) const {
  if (a == b) return own_.at(a);
  const Matrix6d* const block = findBetween(a, b);
  if (block == nullptr) return std::nullopt;
  if (a < b) return *block;
  return block->transpose();
}

}  // namespace waymark::slam
