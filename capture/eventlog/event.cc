#include "capture/eventlog/event.h"

#include "base/big_endian.h"

namespace waymark::eventlog {
bool readHeader(std::span<const std::uint8_t> bytes, Header* header) {
  if (readBigEndian(bytes.first(4)) != kSyncWord) return false;
  header->number = static_cast<std::int64_t>(readBigEndian(bytes.subspan(4, 8)));
  header->utime = static_cast<std::int64_t>(readBigEndian(bytes.subspan(12, 8)));
  header->channel_bytes = readBigEndian(bytes.subspan(20, 4));
  header->data_bytes = readBigEndian(bytes.subspan(24, 4));
  return header->number >= 0 && header->channel_bytes > 0 &&
         header->channel_bytes <= kMaxChannelBytes && header->data_bytes <= kMaxDataBytes;
}

void writeHeader(const Header& header, std::span<std::uint8_t> out) {
  writeBigEndian(kSyncWord, out.first(4));
  writeBigEndian(static_cast<std::uint64_t>(header.number), out.subspan(4, 8));
  writeBigEndian(static_cast<std::uint64_t>(header.utime), out.subspan(12, 8));
  writeBigEndian(header.channel_bytes, out.subspan(20, 4));
  writeBigEndian(header.data_bytes, out.subspan(24, 4));
}

}  // namespace waymark::eventlog
