// A frame as the capture thread hands it on: pixels somebody else owns, and when they were exposed.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
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

  // The same memory as DMABUF, for those who hand it to other devices; -1 where there is none.
  // Nobody else closes it, and it is good as long as the frame is held.
  [[nodiscard]] int dmaBuf() const { return dma_buf_; }

  // The picture as the camera compressed it, where it did and the source was asked to keep it.
  [[nodiscard]] std::span<const std::uint8_t> jpeg() const { return jpeg_; }

  // For sources: the buffer to fill, or the pixels of others to show, and the stamp to set before
  // the frame is handed on.
  [[nodiscard]] std::uint8_t* pixels() { return pixels_.data(); }
  void show(const ImageView& image, int dma_buf) {
    image_ = image;
    dma_buf_ = dma_buf;
  }
  void keepJpeg(std::span<const std::uint8_t> jpeg) { jpeg_.assign(jpeg.begin(), jpeg.end()); }
  void setStamp(const FrameStamp& stamp) { stamp_ = stamp; }

 private:
  friend class FramePool;
  friend struct FrameRelease;
  std::vector<std::uint8_t> pixels_;
  std::vector<std::uint8_t> jpeg_;
  ImageView image_;
  int dma_buf_ = -1;
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
  // Frames without pixels of their own: they show those of others, such as a driver's buffers.
  explicit FramePool(int count) : FramePool(0, 0, count) {}

  // Null when every buffer is in use.
  [[nodiscard]] FramePtr acquire();
  // Frame `index`, of size(); null when it is in use.
  [[nodiscard]] FramePtr acquire(int index);

  [[nodiscard]] bool inUse(int index) const;
  [[nodiscard]] int size() const { return static_cast<int>(frames_.size()); }

 private:
  std::vector<std::unique_ptr<Frame>> frames_;
};

}  // namespace waymark::capture
