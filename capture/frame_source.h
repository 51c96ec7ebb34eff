// Where frames come from: one small interface for cameras, recordings and the simulator.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <variant>

#include "base/result.h"
#include "capture/frame.h"

namespace waymark::capture {

struct StreamInfo {
  int width = 0;                  // pixels
  int height = 0;                 // pixels
  double rate_hz = 0.0;           // nominal; 0 when unknown
  std::int64_t frame_count = -1;  // -1 when unknown or endless
  // Nobody says when the images were taken: one need not look like the one before.
  bool photographs = false;
  bool live = false;        // frames come in real time, whether or not anybody reads
  std::string description;  // for people: "frames.avi, 640x480, 30 Hz"
};

// Nothing came within the time-out; the source is still good.
struct TimedOut {};
// The recording is over.
struct EndOfStream {};

using ReadResult = std::variant<FramePtr, TimedOut, EndOfStream, Error>;

// Counters of a source, by cause; all since it was opened.
struct SourceCounters {
  std::uint64_t frames = 0;             // handed out
  std::uint64_t dropped_late = 0;       // not handed out because their time had passed
  std::uint64_t dropped_no_buffer = 0;  // not handed out because every buffer was in use
};

// Used by one thread: the capture thread, or the loop of an offline run.
class FrameSource {
 public:
  FrameSource() = default;
  FrameSource(const FrameSource&) = delete;
  FrameSource& operator=(const FrameSource&) = delete;
  virtual ~FrameSource() = default;

  [[nodiscard]] virtual const StreamInfo& info() const = 0;

  // The next frame. Recordings return at once; live sources wait, at most `timeout`. An Error ends
  // the stream and names the file or device, the frame and the reason.
  [[nodiscard]] virtual ReadResult read(std::chrono::milliseconds timeout) = 0;

  [[nodiscard]] virtual SourceCounters counters() const = 0;
};

}  // namespace waymark::capture
