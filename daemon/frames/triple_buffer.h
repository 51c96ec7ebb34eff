// The latest value of something large, handed from one thread to another: neither ever waits, the
// writer reuses three buffers for ever, and the reader sees whole values only.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace waymark::daemon {

// For one writer and one reader. The writer fills its buffer and swaps it with the one in the
// middle; the reader swaps its own with the middle one when that is fresh.
template <typename T>
class TripleBuffer {
 public:
  explicit TripleBuffer(const T& initial = T{}) : buffers_{initial, initial, initial} {}

  // Writer: the buffer to fill. Holds some older value, whose memory may be reused.
  [[nodiscard]] T& writeBuffer() { return buffers_[write_]; }
  // Writer: hands it over; a value the reader has not taken is forgotten.
  void publish() { write_ = middle_.exchange(write_ | kFresh, std::memory_order_acq_rel) & kIndex; }

  // Reader: the newest value, or null when there is nothing new since the last call. Valid until
  // the next call that returns one.
  [[nodiscard]] const T* take() {
    if ((middle_.load(std::memory_order_relaxed) & kFresh) == 0) return nullptr;
    read_ = middle_.exchange(read_, std::memory_order_acq_rel) & kIndex;
    return &buffers_[read_];
  }

 private:
  static constexpr std::uint8_t kIndex = 3;
  static constexpr std::uint8_t kFresh = 4;

  std::array<T, 3> buffers_;
  std::uint8_t write_ = 0;
  std::atomic<std::uint8_t> middle_{1};
  std::uint8_t read_ = 2;
};

}  // namespace waymark::daemon
