// Eight floats at a time, for loops over pixels that the compiler would not turn into vectors by
// itself. Whatever the processor has (two SSE or NEON registers, one of AVX2), the bits are the
// same. To be used within functions marked WAYMARK_VECTORIZED.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

// Lanes passed by value are never seen outside of the function they are inlined into, and lanes in
// an array are as aligned as alone.
#pragma GCC diagnostic ignored "-Wpsabi"
#pragma GCC diagnostic ignored "-Wignored-attributes"

namespace waymark::slam {

constexpr std::size_t kLanes = 8;
using Lanes = float __attribute__((vector_size(sizeof(float) * kLanes), may_alias));
using IntLanes = std::int32_t __attribute__((vector_size(sizeof(float) * kLanes), may_alias));

#define WAYMARK_INLINE inline __attribute__((always_inline))

// Precondition: `from` is aligned to whole lanes, and i is a multiple of kLanes.
WAYMARK_INLINE const Lanes& lanesAt(const float* from, std::size_t i) {
  return *reinterpret_cast<const Lanes*>(from + i);
}
WAYMARK_INLINE Lanes& lanesAt(float* from, std::size_t i) {
  return *reinterpret_cast<Lanes*>(from + i);
}

// sums[i] = the sum over the lanes of from[i].
WAYMARK_INLINE void sumEach(const std::array<Lanes, kLanes>& from, Lanes* sums) {
  // Twice as many sums in a vector, of half as many lanes each, in every step.
  const auto fold = [](const Lanes& a, const Lanes& b) {
    return __builtin_shufflevector(a, b, 0, 8, 1, 9, 2, 10, 3, 11) +
           __builtin_shufflevector(a, b, 4, 12, 5, 13, 6, 14, 7, 15);
  };
  const Lanes s04 = fold(from[0], from[4]);
  const Lanes s15 = fold(from[1], from[5]);
  const Lanes s26 = fold(from[2], from[6]);
  const Lanes s37 = fold(from[3], from[7]);
  *sums = fold(fold(s04, s26), fold(s15, s37));
}

// A step from 0 to 1 as a camera blurs it: its height at x and its slope, x in standard deviations
// of the blur. The normal distribution and its density, which need no exponential here: an odd
// polynomial through the Chebyshev nodes of -kBlurReach .. kBlurReach, to 5e-5, and its derivative.
// Beyond, the step is a plain. T: Lanes or float.
template <typename T>
struct BlurredStep {
  T height;
  T slope;
};
constexpr float kBlurReach = 3.5F;
template <typename T>
WAYMARK_INLINE void blurredStepAt(const T& x, BlurredStep<T>* step) {
  T u = x < -kBlurReach ? T{} - kBlurReach : x;
  u = u > kBlurReach ? T{} + kBlurReach : u;
  // In pairs of terms, so that none waits for the one before.
  const T y = u * u;
  const T y2 = y * y;
  const T y4 = y2 * y2;
  const T low = (0.3989172F - 0.06628805F * y) + (9.6978085e-3F - 1.0404083e-3F * y) * y2;
  const T high = (7.5711245e-5F - 3.263257e-6F * y) + 6.1684845e-8F * y2;
  step->height = 0.5F + u * (low + high * y4);
  const T slope_low = (0.3989172F - 0.19886415F * y) + (0.048489043F - 0.0072828581F * y) * y2;
  const T slope_high = (0.00068140121F - 3.5895827e-05F * y) + 8.0190299e-07F * y2;
  step->slope = slope_low + slope_high * y4;
}

}  // namespace waymark::slam
