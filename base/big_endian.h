// Integers as LCM lays them down: the most significant byte first.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace waymark {

// As many bytes as there are, at most 8.
[[nodiscard]] inline std::uint64_t readBigEndian(std::span<const std::uint8_t> bytes) {
  std::uint64_t value = 0;
  for (const std::uint8_t byte : bytes) value = (value << 8U) | byte;
  return value;
}

// The low bytes of the value, as many as there is room for.
inline void writeBigEndian(std::uint64_t value, std::span<std::uint8_t> out) {
  for (std::size_t i = out.size(); i-- > 0; value >>= 8U) {
    out[i] = static_cast<std::uint8_t>(value & 0xffU);
  }
}

}  // namespace waymark
