#include "io/maps/map_keys.h"

#include <cstdint>

#include "io/text/fnv.h"
#include "io/text/json_node.h"

namespace waymark::io::map_keys {

std::string checksum(std::string_view before, std::string_view after) {
  const std::uint64_t hash = fnv1a(after, fnv1a(before));
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string text = "fnv1a64:";
  for (int shift = 60; shift >= 0; shift -= 4) text += kDigits[(hash >> shift) & 0xfU];
  return text;
}

std::string checksumLine(const std::string& value) { return jsonField("checksum", value); }

}  // namespace waymark::io::map_keys
