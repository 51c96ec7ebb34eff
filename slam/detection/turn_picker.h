// Which of too many things are looked at in this frame: the most promising ones, and others in
// turn, so that sooner or later everything is looked at.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace waymark::slam {

class TurnPicker {
 public:
  // turn_share: of what is picked, what has its turn.
  explicit TurnPicker(double turn_share) : turn_share_(turn_share) {}

  // At most `most` indices of `promise`, ascending. `turn` counts how often the same place has been
  // looked at; where calls skip some of its numbers, some of the things may never have their turn.
  // Valid until the next call.
  std::span<const std::uint32_t> pick(std::span<const float> promise, int most, std::uint32_t turn);

 private:
  double turn_share_;
  std::vector<std::uint32_t> picked_;
  std::vector<std::uint32_t> others_;
};

}  // namespace waymark::slam
