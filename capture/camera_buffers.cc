#include "capture/camera_buffers.h"

#include <algorithm>

namespace waymark::capture {
namespace {

using std::chrono::nanoseconds;

// With fewer buffers at the camera than this it may soon have none: frames that come back meanwhile
// are looked for this often.
constexpr int kScarce = 2;
constexpr nanoseconds kScarcePause = std::chrono::milliseconds(1);

}  // namespace

void CameraBuffers::taken() {
  --with_camera_;
  ++taken_;
}

void CameraBuffers::beginTaking() {
  had_ = with_camera_;
  taken_ = 0;
}

void CameraBuffers::countFrame(std::uint32_t sequence, SourceCounters* counters) {
  // Drivers count in 32 bits; one that starts again, or does not count, loses nothing that we know.
  const std::uint32_t step = last_sequence_ ? sequence - *last_sequence_ : 1;
  const std::uint64_t missed = step > 0 && step < (1U << 31U) ? step - 1 : 0;
  (starved_ ? counters->dropped_no_buffer : counters->dropped_gap) += missed;
  last_sequence_ = sequence;
  next_sequence_ += missed + 1;
  // If it had filled all of them, what it took since then found no buffer, though some may have
  // been given back while we took the others.
  starved_ = with_camera_ == 0 || taken_ >= had_;
}

nanoseconds CameraBuffers::patience(nanoseconds rest) const {
  return with_camera_ < kScarce ? std::min(rest, kScarcePause) : rest;
}

}  // namespace waymark::capture
