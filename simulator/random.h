// Random numbers that are the same on every machine.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

#include "base/split_mix.h"

namespace waymark::simulator {

class Random {
 public:
  explicit Random(std::uint64_t seed) : numbers_(seed) {}

  // A generator of its own for each (seed, stream), so that adding draws to one stream leaves the
  // others as they were.
  Random(std::uint64_t seed, std::uint64_t stream) : numbers_(SplitMix64(seed).next() ^ stream) {}

  std::uint64_t next() { return numbers_.next(); }

  // In [low, high).
  double uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(next() >> 11) * 0x1.0p-53;
  }

  // Mean 0, standard deviation 1 (Box and Muller).
  double gaussian() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform(0.0, 1.0)));
    return radius * std::cos(uniform(0.0, 2.0 * std::numbers::pi));
  }

 private:
  SplitMix64 numbers_;
};

}  // namespace waymark::simulator
