// What becomes of memory that is freed.
#pragma once

#include <limits>

#if __has_include(<malloc.h>)
#include <malloc.h>
#endif

namespace waymark {

// From here on the process keeps the memory that it frees for what it allocates next, instead of
// handing it back to the kernel: letting go of a large map's equations takes milliseconds of the
// thread that does it, and touching new memory, page by page, as long again. The process stays as
// large as it once was. Without glibc nothing happens.
inline void keepFreedMemory() {
#if defined(__GLIBC__)
  (void)mallopt(M_MMAP_MAX, 0);
  (void)mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
#endif
}

}  // namespace waymark
