#include "capture/recorded_image.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "base/big_endian.h"
#include "base/decimal_seconds.h"
#include "capture/wire_reader.h"

namespace waymark::capture {
namespace {

using bot_core::image_t;

constexpr int kLargestSide = 16384;  // pixels
// A block of 64 pixels takes a bit at least, and so nobody is given memory for pixels that cannot
// be there.
constexpr std::int64_t kMaxPixelsPerJpegByte = 512;
constexpr std::string_view kMonotonic = "monotonic_ns";
constexpr std::string_view kSequence = "sequence";
constexpr std::string_view kExposure = "exposure_ns";

void setValue(bot_core::image_metadata_t* entry, std::string_view key, std::int64_t value) {
  entry->key = key;
  entry->n = sizeof value;
  entry->value.resize(sizeof value);
  writeBigEndian(static_cast<std::uint64_t>(value), entry->value);
}

std::optional<std::int64_t> value(const image_t& message, std::string_view key) {
  const auto entry = std::ranges::find(message.metadata, key, &bot_core::image_metadata_t::key);
  if (entry == message.metadata.end() || entry->value.size() != sizeof(std::int64_t)) return {};
  return static_cast<std::int64_t>(readBigEndian(entry->value));
}

std::int64_t rowBytes(const image_t& message) {
  return message.row_stride > 0 ? message.row_stride : message.width;
}

Status check(const image_t& message) {
  if (message.width <= 0 || message.height <= 0 || message.width > kLargestSide ||
      message.height > kLargestSide) {
    return Error{"impossible size " + sizeText(message.width, message.height)};
  }
  const auto beyond = [](std::int64_t time, std::int64_t most) {
    return time > most || time < -most;
  };
  if (beyond(message.utime, kFarthest_ns / 1000) ||
      beyond(value(message, kMonotonic).value_or(0), kFarthest_ns)) {
    return Error{"impossible time"};
  }
  const std::int64_t pixels = std::int64_t{message.width} * message.height;
  if (message.pixelformat == image_t::PIXEL_FORMAT_MJPEG) {
    if (message.size >= pixels / kMaxPixelsPerJpegByte) return success();
    return Error{"has " + std::to_string(message.size) + " bytes for a JPEG picture of " +
                 sizeText(message.width, message.height)};
  }
  if (message.pixelformat != image_t::PIXEL_FORMAT_GRAY) {
    return Error{"pixel format " + std::to_string(message.pixelformat) +
                 " is neither GREY nor MJPG"};
  }
  const std::int64_t least = rowBytes(message) * (message.height - 1) + message.width;
  if (rowBytes(message) < message.width || message.size < least) {
    return Error{"has " + std::to_string(message.size) + " bytes for " +
                 sizeText(message.width, message.height)};
  }
  return success();
}

bool decode(std::span<const std::uint8_t> data, image_t* message) {
  WireReader reader(data);
  if (reader.int64() != image_t::getHash()) return false;
  message->utime = reader.int64();
  message->width = reader.int32();
  message->height = reader.int32();
  message->row_stride = reader.int32();
  message->pixelformat = reader.int32();
  message->size = reader.count();
  const auto pixels = reader.bytes(message->size);
  message->data.assign(pixels.begin(), pixels.end());
  constexpr std::size_t kMinEntry = 9;  // bytes: two lengths and the zero of an empty key
  message->nmetadata = reader.count(kMinEntry);
  message->metadata.resize(static_cast<std::size_t>(message->nmetadata));
  for (bot_core::image_metadata_t& entry : message->metadata) {
    entry.key = reader.text();
    entry.n = reader.count();
    const auto value = reader.bytes(entry.n);
    entry.value.assign(value.begin(), value.end());
  }
  return reader.done();
}

}  // namespace

void fillImage(const FrameStamp& stamp, const ImageView& image, std::span<const std::uint8_t> jpeg,
               image_t* message) {
  message->utime = stamp.utime;
  message->width = image.width;
  message->height = image.height;
  if (jpeg.empty()) {
    message->pixelformat = image_t::PIXEL_FORMAT_GRAY;
    message->row_stride = image.width;
    message->data.resize(static_cast<std::size_t>(image.width) *
                         static_cast<std::size_t>(image.height));
    for (int y = 0; y < image.height; ++y) {
      std::copy_n(image.row(y), image.width,
                  message->data.data() + static_cast<std::ptrdiff_t>(y) * image.width);
    }
  } else {
    message->pixelformat = image_t::PIXEL_FORMAT_MJPEG;
    message->row_stride = 0;
    message->data.assign(jpeg.begin(), jpeg.end());
  }
  message->size = static_cast<std::int32_t>(message->data.size());
  message->nmetadata = 3;
  message->metadata.resize(3);
  setValue(&message->metadata[0], kMonotonic, stamp.monotonic_ns);
  setValue(&message->metadata[1], kSequence, static_cast<std::int64_t>(stamp.sequence));
  setValue(&message->metadata[2], kExposure, stamp.exposure_ns);
}

bool isImage(std::span<const std::uint8_t> data) {
  constexpr std::size_t kHashBytes = 8;
  if (data.size() < kHashBytes) return false;
  return static_cast<std::int64_t>(readBigEndian(data.first(kHashBytes))) == image_t::getHash();
}

Status readImage(std::span<const std::uint8_t> data, std::uint64_t sequence, image_t* message,
                 FrameStamp* stamp) {
  if (!decode(data, message)) return Error{"is no whole image message"};
  if (Status checked = check(*message); !checked) return checked;
  const std::int64_t from_wall_ns = 1000 * message->utime;
  *stamp = {.sequence = static_cast<std::uint64_t>(
                value(*message, kSequence).value_or(static_cast<std::int64_t>(sequence))),
            .monotonic_ns = value(*message, kMonotonic).value_or(from_wall_ns),
            .utime = message->utime,
            .exposure_ns = value(*message, kExposure).value_or(0)};
  return success();
}

}  // namespace waymark::capture
