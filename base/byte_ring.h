// Variable pieces of bytes from one thread to another, through memory taken once.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>

namespace waymark {

// For one producer and one consumer; neither waits. Pieces lie in a ring, each behind its length
// and in one stretch: what is left at the end of the memory, when a piece does not fit there, is
// passed over. Positions count up for ever.
class ByteRing {
 public:
  // The memory is touched here, so that no page fault comes later.
  explicit ByteRing(std::size_t capacity)
      : capacity_(roundUp(capacity)),
        memory_(std::make_unique<std::uint64_t[]>(capacity_ / kUnit)) {}

  // What a piece takes of the capacity.
  [[nodiscard]] static constexpr std::size_t bytesFor(std::size_t size) {
    return kUnit + roundUp(size);
  }

  [[nodiscard]] std::size_t capacity() const { return capacity_; }

  // Producer: room for a piece of `size` bytes, to be filled before commit(). Empty when there is
  // none, and for size 0.
  [[nodiscard]] std::span<std::uint8_t> reserve(std::size_t size) {
    const std::size_t needed = kUnit + roundUp(size);
    const std::uint64_t write = write_.load(std::memory_order_relaxed);
    const std::uint64_t read = read_.load(std::memory_order_acquire);
    const std::size_t at = place(write);
    const std::size_t passed = at + needed > capacity_ ? capacity_ - at : 0;
    if (size == 0 || write + passed + needed - read > capacity_) return {};
    if (passed > 0) setLength(at, kPassedOver);
    reserved_ = write + passed;
    setLength(place(reserved_), size);
    return {bytes() + place(reserved_) + kUnit, size};
  }
  // Producer: hands on what reserve() gave room for.
  void commit() {
    write_.store(reserved_ + kUnit + roundUp(length(place(reserved_))), std::memory_order_release);
  }

  // Consumer: the oldest piece, good until pop(); empty when there is none.
  [[nodiscard]] std::span<const std::uint8_t> front() {
    std::uint64_t read = read_.load(std::memory_order_relaxed);
    if (read == write_.load(std::memory_order_acquire)) return {};
    if (length(place(read)) == kPassedOver) {
      read += capacity_ - place(read);
      read_.store(read, std::memory_order_release);
    }
    return {bytes() + place(read) + kUnit, length(place(read))};
  }
  // Consumer. Precondition: front() was not empty.
  void pop() {
    const std::uint64_t read = read_.load(std::memory_order_relaxed);
    read_.store(read + kUnit + roundUp(length(place(read))), std::memory_order_release);
  }

 private:
  static constexpr std::size_t kUnit = sizeof(std::uint64_t);
  static constexpr std::uint64_t kPassedOver = ~std::uint64_t{0};

  [[nodiscard]] static constexpr std::size_t roundUp(std::size_t size) {
    return (size + kUnit - 1) / kUnit * kUnit;
  }
  [[nodiscard]] std::size_t place(std::uint64_t position) const {
    return static_cast<std::size_t>(position % capacity_);
  }
  [[nodiscard]] std::uint8_t* bytes() { return reinterpret_cast<std::uint8_t*>(memory_.get()); }
  [[nodiscard]] std::uint64_t length(std::size_t at) const { return memory_[at / kUnit]; }
  void setLength(std::size_t at, std::uint64_t length) { memory_[at / kUnit] = length; }

  const std::size_t capacity_;  // bytes, a multiple of kUnit
  const std::unique_ptr<std::uint64_t[]> memory_;
  std::uint64_t reserved_ = 0;  // producer's
  alignas(64) std::atomic<std::uint64_t> write_{0};
  alignas(64) std::atomic<std::uint64_t> read_{0};
};

}  // namespace waymark
