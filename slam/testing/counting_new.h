// Counts what each thread takes from the heap. For one source file of a test program.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <new>

namespace waymark::testing {

// Of the calling thread, since it began.
inline thread_local int allocations = 0;

// Null where there is none.
inline void* countedAllocate(std::size_t size, std::size_t alignment) noexcept {
  ++allocations;
  return std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
}

inline void* orThrow(void* memory) {
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}

}  // namespace waymark::testing

void* operator new(std::size_t size) {
  using namespace waymark::testing;
  return orThrow(countedAllocate(size, alignof(std::max_align_t)));
}
void* operator new(std::size_t size, std::align_val_t alignment) {
  using namespace waymark::testing;
  return orThrow(countedAllocate(size, static_cast<std::size_t>(alignment)));
}
// std::stable_sort's.
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  return waymark::testing::countedAllocate(size, alignof(std::max_align_t));
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete(void* memory, const std::nothrow_t&) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }
