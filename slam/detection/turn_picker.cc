#include "slam/detection/turn_picker.h"

#include <algorithm>
#include <cstddef>
#include <numeric>

namespace waymark::slam {
namespace {

// Where turn number `turn` begins among `count`: multiples of the golden ratio, of all numbers that
// whose multiples lie most evenly between 0 and 1 (Knuth, TAOCP 3, 6.4). A share of the whole, not
// a place, so that it does not matter that there are a few more or fewer from turn to turn.
std::size_t beginOf(std::uint32_t turn, std::size_t count) {
  constexpr std::uint32_t kGoldenRatio = 0x9E3779B9U;  // of 2^32
  const std::uint64_t fraction = turn * kGoldenRatio;  // of 2^32, without what is whole
  return static_cast<std::size_t>(fraction * count >> 32U);
}

}  // namespace

std::span<const std::uint32_t> TurnPicker::pick(std::span<const float> promise, int most,
                                                std::uint32_t turn) {
  const std::size_t count = promise.size();
  const std::size_t wanted = std::min(count, static_cast<std::size_t>(std::max(most, 0)));
  const auto in_turn =
      wanted == count ? count : static_cast<std::size_t>(turn_share_ * static_cast<double>(wanted));
  const std::size_t begin = count == 0 ? 0 : beginOf(turn, count);
  picked_.clear();
  others_.clear();
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t after_begin = i >= begin ? i - begin : i + count - begin;
    (after_begin < in_turn ? picked_ : others_).push_back(static_cast<std::uint32_t>(i));
  }
  const auto left = static_cast<std::ptrdiff_t>(wanted - in_turn);
  const auto more_promising = [promise](std::uint32_t a, std::uint32_t b) {
    return promise[a] != promise[b] ? promise[a] > promise[b] : a < b;
  };
  if (left > 0) {
    std::nth_element(others_.begin(), others_.begin() + left - 1, others_.end(), more_promising);
  }
  picked_.insert(picked_.end(), others_.begin(), others_.begin() + left);
  std::ranges::sort(picked_);
  return picked_;
}

}  // namespace waymark::slam
