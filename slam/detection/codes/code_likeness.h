// Does a square look like the print whose code it reads as? A code says on which side of a
// threshold each cell is, and of few cells some photographs and patterns say the same. A print has
// two grey levels, blurred by the lens and unevenly lit; what else there is in the image is not of
// it.
#pragma once

#include <span>

#include "slam/detection/codes/dictionary.h"

namespace waymark::slam {

// The share of the differences between cells that the print of `id` explains: 1 where it looks like
// nothing else, about 0.6 less for a photograph. Grey levels are fitted as the print's, given to
// its neighbours by the blur, under a light that changes linearly; what noise adds is taken off.
// levels: of the cells of the upright print with its border, row by row. variance: of their noise.
// Precondition: cells() * cells() levels.
[[nodiscard]] double codeLikeness(const Dictionary& dictionary, int id,
                                  std::span<const float> levels, double variance);

}  // namespace waymark::slam
