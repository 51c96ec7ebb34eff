// Numbers as the wire has them: USB's are little-endian, those of USB/IP big-endian. Tests only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace waymark::testing {

using Bytes = std::vector<std::uint8_t>;
using ByteView = std::span<const std::uint8_t>;

// Preconditions of the readers: the bytes are there.
[[nodiscard]] inline std::uint16_t readLe16(ByteView bytes, std::size_t at) {
  return static_cast<std::uint16_t>(bytes[at] | bytes[at + 1] << 8);
}
[[nodiscard]] inline std::uint32_t readLe32(ByteView bytes, std::size_t at) {
  return readLe16(bytes, at) | static_cast<std::uint32_t>(readLe16(bytes, at + 2)) << 16;
}
[[nodiscard]] inline std::uint32_t readBe32(ByteView bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value = value << 8 | bytes[at + i];
  return value;
}

class ByteWriter {
 public:
  ByteWriter& u8(unsigned value) {
    bytes_.push_back(static_cast<std::uint8_t>(value));
    return *this;
  }
  ByteWriter& le16(unsigned value) { return u8(value & 0xff).u8(value >> 8 & 0xff); }
  ByteWriter& le32(std::uint32_t value) { return le16(value & 0xffff).le16(value >> 16); }
  ByteWriter& be32(std::uint32_t value) {
    return u8(value >> 24).u8(value >> 16 & 0xff).u8(value >> 8 & 0xff).u8(value & 0xff);
  }
  ByteWriter& append(ByteView bytes) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
    return *this;
  }
  ByteWriter& zeros(std::size_t count) {
    bytes_.resize(bytes_.size() + count);
    return *this;
  }

  [[nodiscard]] std::size_t size() const { return bytes_.size(); }
  [[nodiscard]] Bytes take() { return std::move(bytes_); }

 private:
  Bytes bytes_;
};

}  // namespace waymark::testing
