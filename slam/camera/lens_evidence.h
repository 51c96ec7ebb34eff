// How surely a lens is another one than that in use, where corners are not independent: paper that
// is bent moves its marker's corners in all views alike, a blur those of its keyframe. The usual
// chi-square takes each corner for news, and is a hundred times too large then. Here what belongs
// together counts as one: the sandwich estimator of a variance, by groups (White 1982; Liang and
// Zeger 1986).
#pragma once

#include <algorithm>
#include <span>

#include "base/task.h"
#include "slam/optimization/bundle_problem.h"

namespace waymark::slam {

// How far the lens that was found is from the one in use: chi-square along the way between them, if
// each marker, or each keyframe, has errors of its own. Zero where there are no more of them than a
// lens has unknowns: these do not tell how large their errors are.
struct LensEvidence {
  double by_marker = 0.0;
  double by_keyframe = 0.0;
  [[nodiscard]] double chi2() const { return std::min(by_marker, by_keyframe); }
};

// Of the same observations, each at its best through its lens. huber: beyond it, in whitened
// residuals, errors count linearly. Nothing where the models of the lenses differ.
Task<LensEvidence> lensEvidence(const BundleProblem& in_use, const BundleProblem& found,
                                double huber, Budget* budget);

// From the cost of each group at one end of the way, in its middle, where the sum is least, and at
// its other end, as far again: chi-square of an end, seen from the middle. Precondition: as many of
// each.
[[nodiscard]] double chi2ByGroups(std::span<const double> before, std::span<const double> least,
                                  std::span<const double> beyond);

}  // namespace waymark::slam
