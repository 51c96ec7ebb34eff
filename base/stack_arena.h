// Memory for what a function needs only while it runs: the first bytes are its own, on its stack;
// what does not fit comes from the heap. For std::pmr containers.
#pragma once

#include <array>
#include <cstddef>
#include <memory_resource>

namespace waymark {

template <std::size_t kBytes>
class StackArena {
 public:
  StackArena() : resource_(bytes_.data(), bytes_.size()) {}
  StackArena(const StackArena&) = delete;
  StackArena& operator=(const StackArena&) = delete;
  ~StackArena() = default;

  [[nodiscard]] std::pmr::memory_resource* get() { return &resource_; }

 private:
  alignas(std::max_align_t) std::array<std::byte, kBytes> bytes_;
  std::pmr::monotonic_buffer_resource resource_;
};

}  // namespace waymark
