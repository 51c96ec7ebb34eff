// FNV-1a, 64 bits: a checksum against accidents, not against anybody.
#pragma once

#include <cstdint>
#include <string_view>

namespace waymark::io {

inline constexpr std::uint64_t kFnvOffset = 0xcbf29ce484222325ULL;

// `hash`: that of the bytes before these.
[[nodiscard]] constexpr std::uint64_t fnv1a(std::string_view bytes,
                                            std::uint64_t hash = kFnvOffset) {
  for (const char c : bytes) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 0x100000001b3ULL;
  }
  return hash;
}

}  // namespace waymark::io
