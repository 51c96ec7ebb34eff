// The way from the capture thread to the SLAM loop: a bounded queue in which the producer never
// waits. When it is full, the oldest waiting item goes back to its owner and is counted.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>

namespace waymark::daemon {

// For one producer and one consumer. `Pointer` is a unique_ptr whose deleter has no state (such as
// capture::FramePtr): a slot then is one pointer, and dropping an item is running its deleter.
//
// Items come out in the order they went in, possibly with gaps, never twice. The capacity trades
// latency for loss: 1 always works on the newest frame; more rides out hiccups of the consumer, at
// the price of being that many frames behind while it catches up.
//
// How it works: positions count up for ever, and both sides claim the item at the read position
// with one compare-and-swap: the consumer to have it, the producer to drop it. Whoever wins owns
// it, so the loser needs no second look. As positions never repeat there is no ABA problem, even
// though the same frame buffers come round again and again.
template <typename Pointer>
class NewestWinsQueue {
 public:
  explicit NewestWinsQueue(std::size_t capacity)
      : capacity_(capacity), slots_(std::make_unique<std::atomic<Raw>[]>(capacity)) {}
  NewestWinsQueue(const NewestWinsQueue&) = delete;
  NewestWinsQueue& operator=(const NewestWinsQueue&) = delete;
  ~NewestWinsQueue() {
    while (take()) {
    }
  }

  // Producer: never blocks. Precondition: item is not null and close() was not called.
  void push(Pointer item) {
    const std::uint64_t write = write_.load(std::memory_order_relaxed);
    std::uint64_t read = read_.load(std::memory_order_acquire);
    // A failure means that the consumer has just made room by taking it.
    if (write - read == capacity_) (void)dropAt(read);
    slot(write).store(item.release(), std::memory_order_relaxed);
    write_.store(write + 1, std::memory_order_release);
    notify();
  }

  // Producer: no more will come. The consumer gets what is waiting, then null.
  void close() {
    closed_.store(true, std::memory_order_release);
    notify();
  }

  // Producer: no more will come, and of those waiting the newest is enough; the others are dropped,
  // and counted. A consumer that keeps up loses none, one that is behind is soon done.
  void closeWithNewest() {
    std::uint64_t read = read_.load(std::memory_order_acquire);
    while (write_.load(std::memory_order_relaxed) - read > 1) {
      if (dropAt(read)) ++read;
    }
    close();
  }

  // Producer: nothing waits and the consumer holds nothing it popped. Then, and only then, may the
  // owner of the items go away.
  [[nodiscard]] bool idle() const {
    const std::uint64_t read = read_.load(std::memory_order_acquire);
    return read == write_.load(std::memory_order_relaxed) &&
           !consumer_busy_.load(std::memory_order_acquire);
  }

  // Consumer: the oldest waiting item; waits for one. Null when there is none and the queue is
  // closed, or somebody wakes. Precondition: the item popped before has been let go.
  [[nodiscard]] Pointer pop() {
    for (;;) {
      const std::uint32_t seen = signal_.load(std::memory_order_acquire);
      const bool closed = closed_.load(std::memory_order_acquire);
      const bool woken = woken_.exchange(false, std::memory_order_acq_rel);
      consumer_busy_.store(true, std::memory_order_relaxed);
      if (Pointer item = take()) return item;
      consumer_busy_.store(false, std::memory_order_release);
      if (closed || woken) return nullptr;
      signal_.wait(seen, std::memory_order_acquire);
    }
  }

  // Consumer: nothing waits, and nothing will come.
  [[nodiscard]] bool finished() const {
    return closed_.load(std::memory_order_acquire) &&
           read_.load(std::memory_order_acquire) == write_.load(std::memory_order_acquire);
  }

  // Consumer: nothing waits at this moment.
  [[nodiscard]] bool empty() const {
    return read_.load(std::memory_order_acquire) == write_.load(std::memory_order_acquire);
  }

  // Any thread: lets a consumer that waits look around, and see what else there is to do.
  void wake() {
    woken_.store(true, std::memory_order_release);
    notify();
  }
  [[nodiscard]] std::uint64_t pushed() const { return write_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t dropped() const { return dropped_.load(std::memory_order_relaxed); }

 private:
  using Raw = typename Pointer::pointer;
  static_assert(sizeof(Pointer) == sizeof(Raw), "the deleter must have no state");

  std::atomic<Raw>& slot(std::uint64_t position) { return slots_[position % capacity_]; }

  bool claim(std::uint64_t& position) {
    return read_.compare_exchange_strong(position, position + 1, std::memory_order_acq_rel,
                                         std::memory_order_acquire);
  }

  // Producer. False: the consumer had it, and `position` is where it reads next.
  bool dropAt(std::uint64_t& position) {
    const Raw item = slot(position).load(std::memory_order_relaxed);
    if (!claim(position)) return false;
    Pointer(item).reset();
    dropped_.fetch_add(1, std::memory_order_relaxed);
    return true;
  }

  Pointer take() {
    std::uint64_t read = read_.load(std::memory_order_acquire);
    while (read != write_.load(std::memory_order_acquire)) {
      // May be overwritten while it is looked at; then the claim fails and it counts for nothing.
      const Raw item = slot(read).load(std::memory_order_relaxed);
      if (claim(read)) return Pointer(item);
    }
    return nullptr;
  }

  void notify() {
    signal_.fetch_add(1, std::memory_order_release);
    signal_.notify_one();
  }

  const std::size_t capacity_;
  const std::unique_ptr<std::atomic<Raw>[]> slots_;
  // Each side writes its own cache line.
  alignas(64) std::atomic<std::uint64_t> write_{0};
  std::atomic<std::uint64_t> dropped_{0};
  std::atomic<std::uint32_t> signal_{0};
  std::atomic<bool> closed_{false};
  std::atomic<bool> woken_{false};
  alignas(64) std::atomic<std::uint64_t> read_{0};
  std::atomic<bool> consumer_busy_{false};
};

}  // namespace waymark::daemon
