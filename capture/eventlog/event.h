// LCM's event log format: messages as they were sent, one after the other. lcm-logplayer and
// lcm-spy read it.
//
// An event, integers big-endian: the sync word (4 bytes), the event's number in its log (8), its
// time (8), length of the channel's name (4), length of the data (4), name, data.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace waymark::eventlog {

struct Event {
  std::int64_t number = 0;  // from 0, by 1
  std::int64_t utime = 0;   // microseconds since 1970
  std::string_view channel;
  std::span<const std::uint8_t> data;
};

inline constexpr std::uint32_t kSyncWord = 0xEDA1DA01;
inline constexpr std::size_t kHeaderBytes = 28;
// LCM's own limit for names; for data there is none, but nothing sensible is longer.
inline constexpr std::size_t kMaxChannelBytes = 63;
inline constexpr std::size_t kMaxDataBytes = std::size_t{256} << 20U;

struct Header {
  std::int64_t number = 0;
  std::int64_t utime = 0;
  std::size_t channel_bytes = 0;
  std::size_t data_bytes = 0;

  [[nodiscard]] std::size_t eventBytes() const { return kHeaderBytes + channel_bytes + data_bytes; }
};

// Precondition: bytes.size() >= kHeaderBytes. False where there is no sync word, or lengths that no
// event has; then *header is unspecified.
[[nodiscard]] bool readHeader(std::span<const std::uint8_t> bytes, Header* header);

// Precondition: out.size() >= kHeaderBytes.
void writeHeader(const Header& header, std::span<std::uint8_t> out);

}  // namespace waymark::eventlog
