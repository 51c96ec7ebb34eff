// The recorder thread: frames as the camera brought them and messages as they were published, in
// LCM event logs. What is handed over waits in memory taken at the start; the threads that hand it
// over never wait.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <bot_core/image_t.hpp>

#include "base/byte_ring.h"
#include "capture/eventlog/rolling_log.h"
#include "capture/frame.h"
#include "capture/jpeg_encoder.h"
#include "capture/recorded_file.h"
#include "daemon/health/counter_source.h"
#include "daemon/system/log.h"

namespace waymark::daemon {

struct RecorderOptions {
  eventlog::RollingOptions log;
  bool at_start = true;  // else when somebody asks for it
  bool images = true;    // else only messages
  int jpeg_quality = 0;  // grey images are compressed with it; 0: they are not
  std::string image_channel = "CAMERA";
  std::size_t frame_buffer_bytes = std::size_t{64} << 20U;  // waiting for the disk
  std::size_t message_buffer_bytes = std::size_t{8} << 20U;
};

enum class RecorderState {
  kOff,  // nobody asks for a recording
  kRecording,
  kPaused,  // it should record and cannot; `reason` says why, and it tries again
};

class Recorder {
 public:
  struct Report {
    RecorderState state = RecorderState::kOff;
    std::string reason;  // why it is paused
    std::string file;    // being written
  };

  // Of frame_buffer_bytes, for frames of that size: a piece that is no larger than half of the ring
  // finds room in it when it is empty, wherever it stands.
  [[nodiscard]] static std::size_t leastBufferBytes(int width, int height);

  // Takes the buffers' memory. Each log begins with `files`.
  Recorder(RecorderOptions options, const std::vector<capture::RecordedFile>& files,
           const Log& log);

  // Capture thread. A frame that finds no room is lost, and counted; nothing happens while it is
  // off.
  void addFrame(const capture::Frame& frame);
  // Publisher thread: an encoded message, likewise.
  void addMessage(std::string_view channel, std::span<const std::uint8_t> bytes,
                  std::int64_t utime);

  // Any thread. What comes of it shows in the report.
  void start() { wanted_.store(true, std::memory_order_relaxed); }
  void stop() { wanted_.store(false, std::memory_order_relaxed); }
  [[nodiscard]] Report report() const;
  // Names begin with "recorder.".
  void reportCounters(const CounterSink& sink) const;

  // The thread's body: returns after requestStop(), when all that was handed over is on the disk.
  void run();
  void requestStop() { stop_.store(true, std::memory_order_release); }

 private:
  [[nodiscard]] bool accepts() const { return accepting_.load(std::memory_order_relaxed); }
  void follow();
  void open();
  void close();
  [[nodiscard]] bool drain();
  void writeFrame(std::span<const std::uint8_t> piece);
  void writeMessage(std::span<const std::uint8_t> piece);
  void tell(RecorderState state, std::string_view reason, std::string_view file);
  void publishCounters();

  const RecorderOptions options_;
  const Log& log_;
  std::atomic<bool> wanted_;
  std::atomic<bool> accepting_{false};
  std::atomic<bool> stop_{false};
  ByteRing frames_;
  ByteRing messages_;
  std::atomic<std::uint64_t> frames_lost_{0};
  std::atomic<std::uint64_t> messages_lost_{0};

  // Of the recorder thread.
  std::optional<eventlog::RollingLog> rolling_;
  eventlog::RollingLog::Counters before_;  // of the logs opened earlier
  std::int64_t next_attempt_ns_ = 0;       // to open a log
  std::int64_t retry_s_ = 0;               // the last wait for it
  capture::JpegEncoder jpeg_;
  bot_core::image_t image_;
  std::vector<std::uint8_t> encoded_;

  mutable std::mutex mutex_;  // of what follows: the recorder thread writes, others read
  Report report_;
  eventlog::RollingLog::Counters counters_;
};

}  // namespace waymark::daemon
