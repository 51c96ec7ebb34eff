// A frame as the capture thread hands it on: pixels somebody else owns, and when they were exposed.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "base/image_view.h"

namespace waymark::capture {

// When a frame was taken. Both clocks name mid-exposure.
struct FrameStamp {
  std::uint64_t sequence = 0;     // counts every frame the camera produced, also dropped ones
  std::int64_t monotonic_ns = 0;  // CLOCK_MONOTONIC; for recordings the recorded time
  std::int64_t utime = 0;         // microseconds, wall clock
  std::int64_t exposure_ns = 0;   // 0 when unknown
};

// Grey pixels in a buffer of a FramePool. Frames are born in a pool, travel as FramePtr and go back
// to it when the last holder lets go, from whichever thread that is.
class Frame {
 public:
  [[nodiscard]] ImageView image() const { return image_; }
  [[nodiscard]] const FrameStamp& stamp() const { return stamp_; }

  // For sources: the buffer to fill and the stamp to set before the frame is handed on.
  [[nodiscard]] std::uint8_t* pixels() { return pixels_.data(); }
  void setStamp(const FrameStamp& stamp) { stamp_ = stamp; }

 private:
  friend class FramePool;
  friend struct FrameRelease;
  std::vector<std::uint8_t> pixels_;
  ImageView image_;
  FrameStamp stamp_;
  std::atomic<bool> in_use_{false};
};

struct FrameRelease {
  void operator()(Frame* frame) const { frame->in_use_.store(false, std::memory_order_release); }
};
// The pool must outlive every FramePtr it gave out.
using FramePtr = std::unique_ptr<Frame, FrameRelease>;

// A fixed number of frame buffers, allocated once. acquire() is for one thread; frames come back
// from any thread, without locks.
class FramePool {
 public:
  FramePool(int width, int height, int count);

  // Null when every buffer is in use.
  [[nodiscard]] FramePtr acquire();

  [[nodiscard]] int size() const { return static_cast<int>(frames_.size()); }

 private:
  std::vector<std::unique_ptr<Frame>> frames_;
};

}  // namespace waymark::capture
