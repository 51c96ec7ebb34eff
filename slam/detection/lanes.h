// Eight floats at a time, for loops over pixels that the compiler would not turn into vectors by
// itself. Whatever the processor has (two SSE or NEON registers, one of AVX2), the bits are the
// same. To be used within functions marked WAYMARK_VECTORISED.
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

WAYMARK_INLINE float sumOf(const Lanes& lanes) {
  return ((lanes[0] + lanes[4]) + (lanes[1] + lanes[5])) +
         ((lanes[2] + lanes[6]) + (lanes[3] + lanes[7]));
}

// e^x for -80 <= x <= 0, to 2e-7 of it.
WAYMARK_INLINE Lanes expOf(const Lanes& x) {
  const Lanes y = x * 1.44269504F;
  const IntLanes whole = __builtin_convertvector(y, IntLanes);   // towards zero
  const Lanes part = y - __builtin_convertvector(whole, Lanes);  // -1 .. 0
  Lanes power = part * 1.5252734e-5F + 1.5403530e-4F;            // 2^part, by its series
  power = power * part + 1.3333558e-3F;
  power = power * part + 9.6181291e-3F;
  power = power * part + 5.5504109e-2F;
  power = power * part + 0.24022651F;
  power = power * part + 0.69314718F;
  power = power * part + 1.0F;
  const IntLanes scale = (whole + 127) << 23;
  return power * reinterpret_cast<const Lanes&>(scale);
}

// The normal distribution: its density, and the share below x, to 1e-6 (Abramowitz and Stegun,
// 26.2.17).
struct NormalLanes {
  Lanes cdf;
  Lanes pdf;
};
WAYMARK_INLINE void normalAt(const Lanes& x, NormalLanes* normal) {
  Lanes a = x < 0.0F ? -x : x;
  a = a < 8.0F ? a : 8.0F;
  const Lanes t = 1.0F / (1.0F + 0.2316419F * a);
  normal->pdf = 0.39894228F * expOf(-0.5F * a * a);
  const Lanes polynomial =
      t *
      (0.31938153F + t * (-0.35656378F + t * (1.78147794F + t * (-1.82125598F + t * 1.33027443F))));
  const Lanes tail = normal->pdf * polynomial;
  normal->cdf = x < 0.0F ? tail : 1.0F - tail;
}

}  // namespace waymark::slam
