// A map as it comes over a network: in parts, each with `revision`, `utime`, `piece` and
// `piece_count`. It is there when all parts of one revision are.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>

namespace waymark::io {

enum class PartAdded { kImpossible, kNotWholeYet, kKnown, kWhole };

template <typename Message>
class MapParts {
 public:
  PartAdded add(const Message& part) {
    if (part.piece < 0 || part.piece_count < 1 || part.piece_count > kMostParts ||
        part.piece >= part.piece_count) {
      return PartAdded::kImpossible;
    }
    if (isOf(whole_, part)) return PartAdded::kKnown;
    if (!isOf(coming_, part)) coming_.clear();
    coming_[part.piece] = part;
    if (std::cmp_less(coming_.size(), part.piece_count)) return PartAdded::kNotWholeYet;
    whole_ = std::exchange(coming_, {});
    return PartAdded::kWhole;
  }
  void clear() {
    coming_.clear();
    whole_.clear();
  }
  // The newest one of which every part came, by the parts' numbers; empty before the first.
  [[nodiscard]] const std::map<std::int32_t, Message>& whole() const { return whole_; }
  // Of that.
  [[nodiscard]] std::optional<std::int64_t> revision() const {
    return whole_.empty() ? std::nullopt : std::optional(whole_.begin()->second.revision);
  }

 private:
  static constexpr std::int32_t kMostParts = 200;  // anybody can send
  using Parts = std::map<std::int32_t, Message>;

  // A daemon that starts anew counts its revisions from the beginning: the time tells them apart.
  static bool isOf(const Parts& parts, const Message& part) {
    if (parts.empty()) return false;
    const Message& first = parts.begin()->second;
    return first.revision == part.revision && first.utime == part.utime &&
           first.piece_count == part.piece_count;
  }

  Parts coming_;
  Parts whole_;
};

}  // namespace waymark::io
