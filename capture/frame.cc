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
  for (int i = 0; i < size(); ++i) {
    if (FramePtr frame = acquire(i)) return frame;
  }
  return nullptr;
}

FramePtr FramePool::acquire(int index) {
  Frame* const frame = frames_[static_cast<std::size_t>(index)].get();
  bool expected = false;
  if (!frame->in_use_.compare_exchange_strong(expected, true, std::memory_order_acquire)) {
    return nullptr;
  }
  return FramePtr(frame);
}

bool FramePool::inUse(int index) const {
  return frames_[static_cast<std::size_t>(index)]->in_use_.load(std::memory_order_acquire);
}

}  // namespace waymark::capture
