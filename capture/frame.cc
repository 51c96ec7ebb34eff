#include "capture/frame.h"

#include <cstddef>

namespace waymark::capture {

FramePool::FramePool(int width, int height, int count) {
  frames_.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    auto frame = std::make_unique<Frame>();
    frame->pixels_.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
    frame->image_ = {frame->pixels_.data(), width, height, width};
    frames_.push_back(std::move(frame));
  }
}

FramePtr FramePool::acquire() {
  for (const std::unique_ptr<Frame>& frame : frames_) {
    bool expected = false;
    if (frame->in_use_.compare_exchange_strong(expected, true, std::memory_order_acquire)) {
      return FramePtr(frame.get());
    }
  }
  return nullptr;
}

}  // namespace waymark::capture
