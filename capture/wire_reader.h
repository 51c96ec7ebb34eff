// Reads LCM's wire format from bytes that nobody vouches for. The generated decoders take the
// lengths in a message at their word, and ask for gigabytes or throw when a bit has flipped.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/big_endian.h"

namespace waymark::capture {

// Integers are big-endian. Once something does not fit in what is left, everything reads as zero or
// empty, and ok() is false.
class WireReader {
 public:
  explicit WireReader(std::span<const std::uint8_t> bytes) : left_(bytes) {}

  [[nodiscard]] bool ok() const { return ok_; }
  // Everything was there, and nothing is left over.
  [[nodiscard]] bool done() const { return ok_ && left_.empty(); }

  std::int64_t int64() { return static_cast<std::int64_t>(readBigEndian(take(8))); }
  std::int32_t int32() { return static_cast<std::int32_t>(readBigEndian(take(4))); }
  // How many elements of at least `element_bytes` follow.
  std::int32_t count(std::size_t element_bytes = 1) {
    const std::int32_t n = int32();
    if (n < 0 || static_cast<std::size_t>(n) > left_.size() / element_bytes) ok_ = false;
    return ok_ ? n : 0;
  }
  std::span<const std::uint8_t> bytes(std::int32_t count) {
    return take(count < 0 ? left_.size() + 1 : static_cast<std::size_t>(count));
  }
  // Its length includes the zero at its end.
  std::string_view text() {
    const auto raw = bytes(int32());
    if (raw.empty() || raw.back() != 0) {
      ok_ = false;
      return {};
    }
    return {reinterpret_cast<const char*>(raw.data()), raw.size() - 1};
  }

 private:
  std::span<const std::uint8_t> take(std::size_t size) {
    if (!ok_ || size > left_.size()) {
      ok_ = false;
      return {};
    }
    const auto taken = left_.first(size);
    left_ = left_.subspan(size);
    return taken;
  }

  std::span<const std::uint8_t> left_;
  bool ok_ = true;
};

}  // namespace waymark::capture
