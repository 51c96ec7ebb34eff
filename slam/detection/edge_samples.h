// Pixels near an edge, field by field, as vectorised loops want them.
#pragma once

#include <array>
#include <cstddef>

#include "slam/detection/lanes.h"

namespace waymark::slam {

// One pixel. Distances in pixels.
struct EdgeSample {
  float distance;    // from the first guess of the edge, outwards
  float t;           // along it, 0 at its start, 1 at its end
  float to_start;    // from the side that meets it at its start
  float to_end;      // from the side that meets it at its end
  float thickness;   // of the black border here
  float ring_white;  // how white the code cell behind the border is, 0 .. 1
  float grey;
};

struct EdgeSamples {
  static constexpr std::size_t kCapacity = 2048;
  using Field = std::array<float, kCapacity>;

  // Filled up to whole lanes; what does not count has weight 0, and zeros elsewhere.
  std::size_t count = 0;
  alignas(32) Field distance, t, to_start, to_end, thickness, ring_white, grey, weight;

  void clear() { count = 0; }
  // Precondition: count < kCapacity. To be followed by fillUp().
  void add(const EdgeSample& sample, float sample_weight = 1.0F) {
    distance[count] = sample.distance;
    t[count] = sample.t;
    to_start[count] = sample.to_start;
    to_end[count] = sample.to_end;
    thickness[count] = sample.thickness;
    ring_white[count] = sample.ring_white;
    grey[count] = sample.grey;
    weight[count] = sample_weight;
    ++count;
  }
  void fillUp() {
    while (count % kLanes != 0) add({}, 0.0F);
  }
};

}  // namespace waymark::slam
