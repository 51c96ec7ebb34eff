// The noise of very many corners, without taking longer than a frame has.
#pragma once

#include <span>

#include "base/task.h"

namespace waymark::slam {

// residualSigmaOf (slam/geometry/robust.h), in slices. The squared norms must outlive the task.
Task<double> residualSigma(std::span<const double> squared_norms, Budget* budget);

}  // namespace waymark::slam
