// The capture thread: takes frames from the camera as they come and puts them in the queue. A
// camera that fails is opened again, with growing pauses; a recording that fails ends the run.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>

#include "base/result.h"
#include "capture/frame_source.h"
#include "capture/silence_limit.h"
#include "daemon/frames/camera_status.h"
#include "daemon/frames/newest_wins_queue.h"
#include "daemon/system/log.h"

namespace waymark::daemon {

using FrameQueue = NewestWinsQueue<capture::FramePtr>;

// Opens the source that the configuration names, as often as asked.
struct SourceOpener {
  std::function<Result<std::unique_ptr<capture::FrameSource>>()> open;
  bool comes_back = false;  // a device may fail and return; a recording will not get better
  // Tells that a device has come, which ends a pause; null where nobody knows.
  std::function<bool()> device_came = nullptr;
  // As configured, 0 where it is not: how slowly frames may come.
  double rate_hz = 0.0;
  double exposure_s = 0.0;
};

class CaptureLoop {
 public:
  struct Options {
    std::chrono::milliseconds read_timeout{100};  // how soon a stop is noticed
    capture::SilenceOptions silence = {};         // a device silent for so long has failed
    std::chrono::milliseconds first_pause{100};   // before opening again; doubles up to
    std::chrono::milliseconds max_pause{5000};
  };

  CaptureLoop(SourceOpener opener, FrameQueue& frames, CameraStatus& status, const Log& log,
              const Options& options);
  CaptureLoop(SourceOpener opener, FrameQueue& frames, CameraStatus& status, const Log& log)
      : CaptureLoop(std::move(opener), frames, status, log, Options{}) {}

  // The thread's body: opens the source and reads it. Returns when stopped, or when a recording has
  // ended or failed; closes the queue. The source lives on until the loop is destroyed, as its
  // frames may still be out.
  void run();

  // Every frame goes there as well, before it goes into the queue. Before run().
  using FrameTap = std::function<void(const capture::Frame&)>;
  void setTap(FrameTap tap) { tap_ = std::move(tap); }

  void requestStop() { stop_.store(true, std::memory_order_relaxed); }

  // After run(): why the recording could not be opened or read, if so.
  [[nodiscard]] const std::optional<Error>& failure() const { return failure_; }

 private:
  [[nodiscard]] bool stopped() const { return stop_.load(std::memory_order_relaxed); }
  [[nodiscard]] Status open();
  void readUntilTrouble();
  [[nodiscard]] bool silentTooLong(std::chrono::steady_clock::time_point last_frame) const;
  void handOn(capture::FramePtr frame);
  void lose(const Error& error);
  void discardSource();
  void pause();
  void countFrames();

  const SourceOpener opener_;
  FrameQueue& frames_;
  CameraStatus& status_;
  const Log& log_;
  const Options options_;
  FrameTap tap_;

  std::unique_ptr<capture::FrameSource> source_;
  std::chrono::milliseconds silence_{0};  // of the source, then it has failed
  capture::SourceCounters earlier_;       // of the sources before this one
  std::uint64_t next_sequence_ = 0;       // goes on counting when the camera is opened again
  std::uint64_t sequence_offset_ = 0;
  bool opened_before_ = false;
  std::chrono::milliseconds pause_;
  bool over_ = false;
  std::optional<Error> failure_;
  std::atomic<bool> stop_{false};
};

}  // namespace waymark::daemon
