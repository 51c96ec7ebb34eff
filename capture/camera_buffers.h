// A camera's buffers and its count of frames, for every kind of driver: how many buffers it has,
// which of them frames still show, and how many frames never came to us, and why.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/result.h"
#include "capture/frame_source.h"

namespace waymark::capture {

class CameraBuffers {
 public:
  CameraBuffers() = default;
  // All of them are ours at first.
  explicit CameraBuffers(int count) : shown_(static_cast<std::size_t>(count), false) {}

  [[nodiscard]] int count() const { return static_cast<int>(shown_.size()); }

  // Buffers that the camera has, filled or not, until we take them: without one, frames are lost.
  [[nodiscard]] int withCamera() const { return with_camera_; }
  void given() { ++with_camera_; }
  void taken();

  // Before those that wait are taken, one after the other.
  void beginTaking();
  // The frame in the buffer that was just taken has this number in the camera's own count, which
  // goes on over frames that it had no buffer for, or that got lost on the way. Those are added to
  // *counters.
  void countFrame(std::uint32_t sequence, SourceCounters* counters);
  // Ours, of the frame counted last: from 0, with the missing ones, in 64 bits.
  [[nodiscard]] std::uint64_t sequence() const { return next_sequence_ - 1; }

  // A frame shows this buffer, and may be held for long.
  void show(int index) { shown_[static_cast<std::size_t>(index)] = true; }
  // Gives those back whose frames have been let go. `is_shown(index)`: whether the frame is still
  // held; `give(index)`: a Status.
  template <typename IsShown, typename Give>
  [[nodiscard]] Status takeBack(const IsShown& is_shown, const Give& give);

  // How long to wait for a frame when there is that much time: with few buffers at the camera not
  // for long, as those that come back meanwhile have to be given to it.
  [[nodiscard]] std::chrono::nanoseconds patience(std::chrono::nanoseconds rest) const;

 private:
  std::vector<bool> shown_;
  int with_camera_ = 0;
  int had_ = 0;           // when taking began
  int taken_ = 0;         // since then
  bool starved_ = false;  // since the last frame there was a time when the camera had no buffer
  std::optional<std::uint32_t> last_sequence_;  // the camera's
  std::uint64_t next_sequence_ = 0;             // ours
};

template <typename IsShown, typename Give>
Status CameraBuffers::takeBack(const IsShown& is_shown, const Give& give) {
  for (int i = 0; i < count(); ++i) {
    const auto place = static_cast<std::size_t>(i);
    if (!shown_[place] || is_shown(i)) continue;
    shown_[place] = false;
    if (Status status = give(i); !status) return status;
  }
  return success();
}

}  // namespace waymark::capture
