// Marks a function whose loops are worth compiling for several processors: the best version that
// the machine has is taken when the program starts. Portable builds so stay portable; elsewhere
// (arm64's NEON is always there) the compiler's ordinary version does.
//
// All versions give the same bits: integers, or floating point without sums that a compiler may
// reorder, and none contracts a multiplication and an addition into one; tests/portability_test
// holds them to it.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define WAYMARK_VECTORIZED __attribute__((target_clones("avx2", "default")))
#else
#define WAYMARK_VECTORIZED
#endif
