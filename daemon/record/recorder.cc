#include "daemon/record/recorder.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <thread>
#include <type_traits>
#include <utility>

#include "base/clock.h"
#include "capture/recorded_image.h"

namespace waymark::daemon {
namespace {

// Between two looks at the buffers; they hold much more than comes within it.
constexpr auto kPause = std::chrono::milliseconds(5);

// What stands before the pixels, or the camera's own JPEG, in the ring.
struct FrameHeader {
  capture::FrameStamp stamp;
  std::int32_t width = 0;   // pixels
  std::int32_t height = 0;  // pixels
  bool is_jpeg = false;
};

// What stands before the channel's name and the message in the ring.
struct MessageHeader {
  std::int64_t utime = 0;
  std::uint32_t channel_bytes = 0;
};

static_assert(std::is_trivially_copyable_v<FrameHeader>);

template <typename Header>
Header headerOf(std::span<const std::uint8_t> piece) {
  Header header;
  std::memcpy(&header, piece.data(), sizeof header);
  return header;
}

RecorderOptions withPreamble(RecorderOptions options,
                             const std::vector<capture::RecordedFile>& files) {
  for (const capture::RecordedFile& file : files) {
    options.log.preamble.push_back({capture::RecordedFile::kChannel, encodeFile(file, wallUs())});
  }
  return options;
}

eventlog::RollingLog::Counters operator+(eventlog::RollingLog::Counters a,
                                         const eventlog::RollingLog::Counters& b) {
  a.events += b.events;
  a.bytes += b.bytes;
  a.lost += b.lost;
  a.files += b.files;
  a.deleted += b.deleted;
  a.pauses += b.pauses;
  return a;
}

}  // namespace

std::size_t Recorder::leastBufferBytes(int width, int height) {
  return 2 * ByteRing::bytesFor(sizeof(FrameHeader) +
                                static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
}

Recorder::Recorder(RecorderOptions options, const std::vector<capture::RecordedFile>& files,
                   const Log& log)
    : options_(withPreamble(std::move(options), files)),
      log_(log),
      wanted_(options_.at_start),
      accepting_(options_.at_start),  // what comes before the thread runs is kept, too
      frames_(options_.images ? options_.frame_buffer_bytes : sizeof(FrameHeader)),
      messages_(options_.message_buffer_bytes) {}

void Recorder::addFrame(const capture::Frame& frame) {
  if (!accepts() || !options_.images) return;
  const ImageView image = frame.image();
  const std::span<const std::uint8_t> jpeg = frame.jpeg();
  const auto row_bytes = static_cast<std::size_t>(image.width);
  const std::size_t bytes =
      jpeg.empty() ? row_bytes * static_cast<std::size_t>(image.height) : jpeg.size();
  const std::span<std::uint8_t> piece = frames_.reserve(sizeof(FrameHeader) + bytes);
  if (piece.empty()) {
    frames_lost_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  const FrameHeader header{frame.stamp(), image.width, image.height, !jpeg.empty()};
  std::memcpy(piece.data(), &header, sizeof header);
  std::uint8_t* out = piece.data() + sizeof header;
  if (!jpeg.empty()) {
    std::memcpy(out, jpeg.data(), jpeg.size());
  } else {
    for (int y = 0; y < image.height; ++y) out = std::copy_n(image.row(y), row_bytes, out);
  }
  frames_.commit();
}

void Recorder::addMessage(std::string_view channel, std::span<const std::uint8_t> bytes,
                          std::int64_t utime) {
  if (!accepts()) return;
  const MessageHeader header{utime, static_cast<std::uint32_t>(channel.size())};
  const std::span<std::uint8_t> piece =
      messages_.reserve(sizeof header + channel.size() + bytes.size());
  if (piece.empty()) {
    messages_lost_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  std::memcpy(piece.data(), &header, sizeof header);
  std::uint8_t* const name = piece.data() + sizeof header;
  std::ranges::copy(bytes, std::ranges::copy(channel, name).out);
  messages_.commit();
}

Recorder::Report Recorder::report() const {
  const std::lock_guard lock(mutex_);
  return report_;
}

void Recorder::reportCounters(const CounterSink& sink) const {
  eventlog::RollingLog::Counters counters;
  {
    const std::lock_guard lock(mutex_);
    counters = counters_;
  }
  sink("recorder.events", counters.events);
  sink("recorder.bytes", counters.bytes);
  sink("recorder.files", counters.files);
  sink("recorder.deleted", counters.deleted);
  sink("recorder.pauses", counters.pauses);
  sink("recorder.lost_paused", counters.lost);
  sink("recorder.lost_frames", frames_lost_.load(std::memory_order_relaxed));
  sink("recorder.lost_messages", messages_lost_.load(std::memory_order_relaxed));
}

void Recorder::run() {
  for (bool more = true; more;) {
    const bool stopping = stop_.load(std::memory_order_acquire);
    follow();
    const bool wrote = drain();
    if (rolling_) rolling_->maintain(monotonicNs());
    publishCounters();
    more = wrote || !stopping;
    if (more && !wrote) std::this_thread::sleep_for(kPause);
  }
  close();
}

// Opens and closes the log as it is wanted.
void Recorder::follow() {
  const bool wanted = wanted_.load(std::memory_order_relaxed);
  accepting_.store(wanted, std::memory_order_relaxed);
  if (wanted && !rolling_ && monotonicNs() >= next_attempt_ns_) open();
  if (!wanted && rolling_) {
    while (drain()) {
    }
    close();
  }
  if (!wanted) {
    next_attempt_ns_ = 0;
    retry_s_ = 0;
    tell(RecorderState::kOff, "", "");
  } else if (rolling_ && rolling_->state() == eventlog::RollingLog::State::kPaused) {
    tell(RecorderState::kPaused, rolling_->reason(), "");
  } else if (rolling_) {
    tell(RecorderState::kRecording, "", rolling_->file().native());
  }
}

void Recorder::open() {
  Result<eventlog::RollingLog> opened = eventlog::RollingLog::open(options_.log);
  if (!opened) {
    const eventlog::RollingOptions& log = options_.log;
    retry_s_ = std::clamp(2 * retry_s_, log.retry_first_s, log.retry_max_s);
    next_attempt_ns_ = monotonicNs() + retry_s_ * 1'000'000'000;
    tell(RecorderState::kPaused, opened.error().message, "");
    return;
  }
  retry_s_ = 0;
  rolling_.emplace(std::move(opened).value());
  if (!rolling_->repaired().empty()) log_.warning("recorder: " + rolling_->repaired());
}

void Recorder::close() {
  if (!rolling_) return;
  rolling_->finish();
  if (rolling_->state() == eventlog::RollingLog::State::kPaused) {
    tell(RecorderState::kPaused, rolling_->reason(), "");
  }
  publishCounters();
  before_ = before_ + rolling_->counters();
  rolling_.reset();
}

// What waits, or a good part of it. False when nothing did.
bool Recorder::drain() {
  constexpr int kFrames = 100;
  bool any = false;
  bool more = true;
  for (int i = 0; i < kFrames && more; ++i) {
    more = false;
    // In turns, so that a frame and its pose are near each other in the log.
    if (const auto frame = frames_.front(); !frame.empty()) {
      writeFrame(frame);
      frames_.pop();
      more = true;
    }
    for (auto message = messages_.front(); !message.empty(); message = messages_.front()) {
      writeMessage(message);
      messages_.pop();
      more = true;
    }
    any |= more;
  }
  return any;
}

void Recorder::writeFrame(std::span<const std::uint8_t> piece) {
  if (!rolling_) {
    if (accepts()) ++before_.lost;
    return;
  }
  const auto header = headerOf<FrameHeader>(piece);
  const std::span<const std::uint8_t> bytes = piece.subspan(sizeof header);
  const ImageView image{bytes.data(), header.width, header.height, header.width};
  std::span<const std::uint8_t> jpeg;
  if (header.is_jpeg) {
    jpeg = bytes;
  } else if (options_.jpeg_quality > 0) {
    jpeg = jpeg_.encode(image, options_.jpeg_quality);
  }
  capture::fillImage(header.stamp, image, jpeg, &image_);
  encoded_.resize(static_cast<std::size_t>(image_.getEncodedSize()));
  image_.encode(encoded_.data(), 0, static_cast<int>(encoded_.size()));
  rolling_->append(header.stamp.utime, options_.image_channel, encoded_, monotonicNs());
}

void Recorder::writeMessage(std::span<const std::uint8_t> piece) {
  if (!rolling_) {
    if (accepts()) ++before_.lost;
    return;
  }
  const auto header = headerOf<MessageHeader>(piece);
  const auto* const name = reinterpret_cast<const char*>(piece.data() + sizeof header);
  rolling_->append(header.utime, {name, header.channel_bytes},
                   piece.subspan(sizeof header + header.channel_bytes), monotonicNs());
}

// Called often, while little changes. What there is, only this thread writes: reading it takes no
// lock.
void Recorder::tell(RecorderState state, std::string_view reason, std::string_view file) {
  if (state == report_.state && reason == report_.reason && file == report_.file) return;
  if (state != report_.state || reason != report_.reason) {
    if (state == RecorderState::kPaused) log_.warning("recorder: paused: " + std::string(reason));
    if (state == RecorderState::kRecording) log_.info("recorder: recording");
    if (state == RecorderState::kOff) log_.info("recorder: stopped");
  }
  const std::lock_guard lock(mutex_);
  report_ = {state, std::string(reason), std::string(file)};
}

void Recorder::publishCounters() {
  const eventlog::RollingLog::Counters total = rolling_ ? before_ + rolling_->counters() : before_;
  if (total == counters_) return;
  const std::lock_guard lock(mutex_);
  counters_ = total;
}

}  // namespace waymark::daemon
