#include "capture/log_source.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <span>
#include <string>
#include <system_error>
#include <utility>

#include "base/image_view.h"
#include "capture/eventlog/log_reader.h"
#include "capture/eventlog/recording_name.h"
#include "capture/jpeg_decoder.h"
#include "capture/recorded_image.h"

namespace waymark::capture {
namespace {

// The next event that is an image, decoded. Empty at the end.
struct ReadImage {
  Status status = success();  // why it cannot be used, if so
  FrameStamp stamp;
};
Result<std::optional<ReadImage>> nextImage(eventlog::LogReader& reader, std::uint64_t sequence,
                                           bot_core::image_t* message) {
  for (;;) {
    const Result<std::optional<eventlog::Event>> event = reader.next();
    if (!event) return event.error();
    if (!*event) return std::optional<ReadImage>();
    if (!isImage((*event)->data)) continue;
    ReadImage image;
    image.status = readImage((*event)->data, sequence, message, &image.stamp);
    return std::optional(std::move(image));
  }
}

std::string joined(const std::string& a, const std::string& b) {
  return a.empty() || b.empty() ? a + b : a + "; " + b;
}

// Empty when all of it can be read.
std::string damageOf(const std::filesystem::path& file, const eventlog::LogReader& reader) {
  if (reader.damages() == 0) return {};
  return file.string() + ": " + std::to_string(reader.damagedBytes()) + " bytes in " +
         std::to_string(reader.damages()) + " places hold no whole event, the first at byte " +
         std::to_string(reader.damage().front().offset);
}

class LogSource final : public FrameSource {
 public:
  LogSource(std::filesystem::path file, eventlog::LogReader reader, const StreamInfo& info,
            std::optional<double> fps, bool keep_jpeg, int buffers)
      : file_(std::move(file)),
        reader_(std::move(reader)),
        info_(info),
        fps_(fps),
        keep_jpeg_(keep_jpeg),
        pool_(info.width, info.height, buffers) {}

  [[nodiscard]] const StreamInfo& info() const override { return info_; }
  [[nodiscard]] SourceCounters counters() const override { return counters_; }
  [[nodiscard]] ReadResult read(std::chrono::milliseconds timeout) override;
  [[nodiscard]] std::string damage() const override;

 private:
  [[nodiscard]] Result<std::optional<ReadImage>> nextImageOfAll();
  [[nodiscard]] bool unpack(std::uint8_t* grey);
  [[nodiscard]] FrameStamp stamp(const FrameStamp& recorded) const;

  std::filesystem::path file_;  // the one that is read now
  eventlog::LogReader reader_;
  std::string earlier_damage_;  // of the files before it
  StreamInfo info_;
  std::optional<double> fps_;
  bool keep_jpeg_;
  FramePool pool_;
  JpegDecoder jpeg_;
  bot_core::image_t message_;
  SourceCounters counters_;
};

ReadResult LogSource::read(std::chrono::milliseconds /*timeout*/) {
  FramePtr frame = pool_.acquire();
  if (!frame) return TimedOut{};
  for (;;) {
    const Result<std::optional<ReadImage>> image = nextImageOfAll();
    if (!image) return image.error();
    if (!*image) return EndOfStream{};
    if (!(*image)->status || !unpack(frame->pixels())) {
      ++counters_.dropped_corrupt;
      continue;
    }
    const bool is_jpeg = message_.pixelformat == bot_core::image_t::PIXEL_FORMAT_MJPEG;
    frame->keepJpeg(keep_jpeg_ && is_jpeg ? std::span<const std::uint8_t>(message_.data)
                                          : std::span<const std::uint8_t>());
    frame->setStamp(stamp((*image)->stamp));
    ++counters_.frames;
    return frame;
  }
}

// A recording in several files goes on in the next one.
Result<std::optional<ReadImage>> LogSource::nextImageOfAll() {
  for (;;) {
    Result<std::optional<ReadImage>> image =
        nextImage(reader_, counters_.frames + counters_.dropped_corrupt, &message_);
    if (!image || *image) return image;
    std::error_code error;
    const std::filesystem::path next = eventlog::nextFile(file_);
    if (next.empty() || !std::filesystem::exists(next, error)) return image;
    Result<eventlog::LogReader> reader = eventlog::LogReader::open(next);
    if (!reader) return reader.error();
    earlier_damage_ = joined(earlier_damage_, damageOf(file_, reader_));
    reader_ = std::move(reader).value();
    file_ = next;
  }
}

bool LogSource::unpack(std::uint8_t* grey) {
  if (message_.width != info_.width || message_.height != info_.height) return false;
  if (message_.pixelformat == bot_core::image_t::PIXEL_FORMAT_MJPEG) {
    return !jpeg_.decode(message_.data, info_.width, info_.height, grey);
  }
  const std::ptrdiff_t stride = std::max(message_.row_stride, message_.width);
  for (int y = 0; y < info_.height; ++y) {
    std::copy_n(message_.data.data() + y * stride, info_.width,
                grey + static_cast<std::ptrdiff_t>(y) * info_.width);
  }
  return true;
}

FrameStamp LogSource::stamp(const FrameStamp& recorded) const {
  if (!fps_) return recorded;
  FrameStamp given = recorded;
  given.sequence = counters_.frames;
  given.monotonic_ns =
      static_cast<std::int64_t>(std::llround(1e9 * static_cast<double>(given.sequence) / *fps_));
  given.utime = given.monotonic_ns / 1000;
  return given;
}

std::string LogSource::damage() const {
  std::string text = joined(earlier_damage_, damageOf(file_, reader_));
  if (counters_.dropped_corrupt > 0) {
    text = joined(text, file_.string() + ": " + std::to_string(counters_.dropped_corrupt) +
                            " images cannot be decoded");
  }
  return text;
}

// The first image that can be read says the size, and the next one the rate.
Result<StreamInfo> describe(const std::filesystem::path& file, eventlog::LogReader& reader,
                            std::optional<double> fps) {
  StreamInfo info;
  std::optional<FrameStamp> first;
  bot_core::image_t message;
  for (;;) {
    const Result<std::optional<ReadImage>> image = nextImage(reader, 0, &message);
    if (!image) return image.error();
    if (!*image && !first)
      return Error{file.string() + ": the log holds no image that can be read"};
    if (!*image) break;
    if (!(*image)->status) continue;
    if (first) {
      const std::int64_t apart_ns = (*image)->stamp.monotonic_ns - first->monotonic_ns;
      if (apart_ns > 0) info.rate_hz = 1e9 / static_cast<double>(apart_ns);
      break;
    }
    first = (*image)->stamp;
    info.width = message.width;
    info.height = message.height;
  }
  if (fps) info.rate_hz = *fps;
  info.description = file.string() + ", " + sizeText(info.width, info.height) + ", event log";
  return info;
}

}  // namespace

bool isEventLog(const std::filesystem::path& file) {
  // Opening a FIFO waits for who writes into it.
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return false;
  std::array<char, eventlog::kHeaderBytes> bytes{};
  std::ifstream in(file, std::ios::binary);
  if (!in.read(bytes.data(), bytes.size())) return false;
  eventlog::Header header;
  return eventlog::readHeader({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()},
                              &header);
}

Result<std::unique_ptr<FrameSource>> openLog(const std::filesystem::path& file,
                                             std::optional<double> fps, bool keep_jpeg,
                                             int buffers) {
  Result<eventlog::LogReader> first = eventlog::LogReader::open(file);
  if (!first) return first.error();
  Result<StreamInfo> info = describe(file, *first, fps);
  if (!info) return info.error();
  Result<eventlog::LogReader> reader = eventlog::LogReader::open(file);
  if (!reader) return reader.error();
  return std::unique_ptr<FrameSource>(std::make_unique<LogSource>(
      file, std::move(reader).value(), std::move(info).value(), fps, keep_jpeg, buffers));
}

}  // namespace waymark::capture
