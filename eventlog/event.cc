#include "eventlog/event.h"

namespace waymark::eventlog {
namespace {

// Big-endian, as LCM lays them.
std::uint64_t readWord(std::span<const std::uint8_t> bytes) {
  std::uint64_t value = 0;
  for (const std::uint8_t byte : bytes) value = (value << 8U) | byte;
  return value;
}

void writeWord(std::uint64_t value, std::span<std::uint8_t> out) {
  for (std::size_t i = out.size(); i-- > 0; value >>= 8U) {
    out[i] = static_cast<std::uint8_t>(value & 0xffU);
  }
}

}  // namespace

bool readHeader(std::span<const std::uint8_t> bytes, Header* header) {
  if (readWord(bytes.first(4)) != kSyncWord) return false;
  header->number = static_cast<std::int64_t>(readWord(bytes.subspan(4, 8)));
  header->utime = static_cast<std::int64_t>(readWord(bytes.subspan(12, 8)));
  header->channel_bytes = readWord(bytes.subspan(20, 4));
  header->data_bytes = readWord(bytes.subspan(24, 4));
  return header->number >= 0 && header->channel_bytes > 0 &&
         header->channel_bytes <= kMostChannelBytes && header->data_bytes <= kMostDataBytes;
}

void writeHeader(const Header& header, std::span<std::uint8_t> out) {
  writeWord(kSyncWord, out.first(4));
  writeWord(static_cast<std::uint64_t>(header.number), out.subspan(4, 8));
  writeWord(static_cast<std::uint64_t>(header.utime), out.subspan(12, 8));
  writeWord(header.channel_bytes, out.subspan(20, 4));
  writeWord(header.data_bytes, out.subspan(24, 4));
}

}  // namespace waymark::eventlog
