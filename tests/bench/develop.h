// From light to pixels.
#pragma once

#include <cstdint>
#include <vector>

#include "simulator/random.h"

namespace waymark::bench {

// Means of three by three pixels, and the sensor's noise: grey levels of what `light`, row by row,
// has for each pixel.
void develop(const std::vector<float>& light, int width, int height, double noise_sigma,
             simulator::Random* random, std::vector<std::uint8_t>* pixels);

}  // namespace waymark::bench
