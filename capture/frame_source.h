// Where frames come from: one small interface for cameras, recordings and the simulator.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

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
  // What the user should know of how it was opened, a line each: what the camera rejected.
  std::vector<std::string> warnings = {};
};

// Nothing came within the time-out; the source is still good.
struct TimedOut {};
// The recording is over.
struct EndOfStream {};

using ReadResult = std::variant<FramePtr, TimedOut, EndOfStream, Error>;

// Counters of a source, by cause; all since it was opened. Each frame that the camera took is in
// `frames` or in one of dropped_*.
struct SourceCounters {
  std::uint64_t frames = 0;             // handed out
  std::uint64_t dropped_late = 0;       // not handed out because their time had passed
  std::uint64_t dropped_no_buffer = 0;  // never taken because every buffer was in use
  std::uint64_t dropped_gap = 0;        // lost on the way to us, as the camera's own count says
  std::uint64_t dropped_flagged = 0;    // the driver says that the data are faulty
  std::uint64_t dropped_corrupt = 0;    // too short, or not to be decoded
  // Of `frames`: stamped when they arrived, as the driver did not say when they were taken.
  std::uint64_t stamped_on_arrival = 0;
};

// Every counter with its name in health messages.
struct NamedSourceCounter {
  const char* name;
  std::uint64_t SourceCounters::*value;
};
inline constexpr std::array kSourceCounters = {
    NamedSourceCounter{"camera.frames", &SourceCounters::frames},
    NamedSourceCounter{"camera.stamped_on_arrival", &SourceCounters::stamped_on_arrival},
    NamedSourceCounter{"dropped.source_late", &SourceCounters::dropped_late},
    NamedSourceCounter{"dropped.source_no_buffer", &SourceCounters::dropped_no_buffer},
    NamedSourceCounter{"dropped.source_gap", &SourceCounters::dropped_gap},
    NamedSourceCounter{"dropped.source_flagged", &SourceCounters::dropped_flagged},
    NamedSourceCounter{"dropped.source_corrupt", &SourceCounters::dropped_corrupt},
};

[[nodiscard]] inline SourceCounters operator+(SourceCounters a, const SourceCounters& b) {
  for (const NamedSourceCounter& counter : kSourceCounters) a.*counter.value += b.*counter.value;
  return a;
}

// Of a recording: frames that may be out at once, unless somebody asks for more.
inline constexpr int kRecordingBuffers = 4;

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

  // What of a recording could not be read up to now, and where: one line; empty when all could.
  [[nodiscard]] virtual std::string damage() const { return {}; }

  // What people know a frame by: its place in the stream, or the file it came from.
  [[nodiscard]] virtual std::string frameName(std::uint64_t sequence) const {
    return "frame " + std::to_string(sequence);
  }
};

}  // namespace waymark::capture
