// Between the SLAM thread and the one that makes small images for people: one frame at a time goes
// there, as a copy, and only while somebody has asked. Neither waits for the other, no driver's
// buffer is held, and what is copied has its place from the start.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <semaphore>
#include <span>
#include <vector>

#include "base/image_view.h"
#include "capture/frame.h"
#include "slam/detection/marker_detection.h"

namespace waymark::daemon {

class PreviewLink {
 public:
  // Monotonic nanoseconds.
  static constexpr std::int64_t kLease_ns = 5'000'000'000;   // of one request
  static constexpr std::int64_t kInterval_ns = 240'000'000;  // between two images, at least
  // Of more markers the others are left out.
  static constexpr std::size_t kMostSeen = 256;

  struct Query {
    capture::FrameStamp stamp;
    ImageView image;
    std::size_t seen = 0;
    std::array<std::array<Eigen::Vector2d, 4>, kMostSeen> markers;  // pixels
  };

  // Images will have this size, pixels.
  PreviewLink(int width, int height);

  // Any thread: somebody wants to look, for kLease_ns from now.
  void ask(std::int64_t now_ns);

  // SLAM thread: an image is asked for and due, and the other thread has nothing to do.
  [[nodiscard]] bool wanted(std::int64_t now_ns) const;
  // SLAM thread, when wanted, after the frame.
  void give(const capture::FrameStamp& stamp, const ImageView& image,
            std::span<const slam::MarkerDetection> markers, std::int64_t now_ns);

  // The other thread: waits for a frame; null when there will be none. Valid until done().
  [[nodiscard]] const Query* wait();
  void done() { taken_.store(false, std::memory_order_release); }

  // Any thread.
  void requestStop();

 private:
  std::atomic<std::int64_t> asked_until_ns_{0};
  std::atomic<bool> taken_{false};  // what is below is the other thread's
  std::atomic<bool> stop_{false};
  std::counting_semaphore<> wake_{0};  // by one for each frame, and for a stop
  std::int64_t next_ns_ = 0;           // of the SLAM thread

  std::vector<std::uint8_t> pixels_;
  Query query_;
};

}  // namespace waymark::daemon
