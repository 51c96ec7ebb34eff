// What is wrong with the bytes of an image file, as far as that can be told without decoding it.
// Decoders show half a JPEG grey below, and write of a bad PNG to stderr by themselves.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include <boost/crc.hpp>

namespace waymark {
namespace coded_image {

inline std::uint32_t byteAt(std::string_view bytes, std::size_t i) {
  return static_cast<unsigned char>(bytes[i]);
}

// Has a JPEG its end? What follows the end mark (a camera's own trailers) does not count, nor does
// one within a segment (a thumbnail's).
inline bool isWholeJpeg(std::string_view bytes) {
  std::size_t at = 2;  // behind the mark of the beginning
  while (at + 1 < bytes.size()) {
    const std::uint32_t mark = byteAt(bytes, at + 1);
    // Pictures' data, stuffed FF (FF 00), restarts (FF D0 to D7), and fill bytes before a mark.
    const bool data = byteAt(bytes, at) != 0xFF || mark == 0 || (mark >= 0xD0 && mark <= 0xD7);
    if (data || mark == 0xFF) {
      at += data && byteAt(bytes, at) == 0xFF ? 2 : 1;
    } else if (mark == 0xD9) {
      return true;
    } else if (at + 3 < bytes.size()) {
      at += 2U + (byteAt(bytes, at + 2) << 8U) + byteAt(bytes, at + 3);  // a segment's length
    } else {
      return false;
    }
  }
  return false;
}

// Chunks: length, type, data, checksum of type and data.
inline const char* pngFault(std::string_view bytes) {
  const auto numberAt = [&](std::size_t i) {
    return byteAt(bytes, i) << 24U | byteAt(bytes, i + 1) << 16U | byteAt(bytes, i + 2) << 8U |
           byteAt(bytes, i + 3);
  };
  constexpr std::size_t kAround = 12;  // bytes of a chunk beside its data
  std::size_t at = 8;                  // behind the signature
  while (at + kAround <= bytes.size()) {
    const std::size_t length = numberAt(at);
    if (length > bytes.size() - at - kAround) return "is cut off";
    boost::crc_32_type checksum;
    checksum.process_bytes(bytes.data() + at + 4, length + 4);
    if (checksum.checksum() != numberAt(at + 8 + length)) return "is damaged";
    if (bytes.substr(at + 4, 4) == "IEND") return nullptr;
    at += kAround + length;
  }
  return "is cut off";
}

}  // namespace coded_image

inline bool isJpeg(std::string_view bytes) { return bytes.starts_with("\xff\xd8"); }
inline bool isPng(std::string_view bytes) { return bytes.starts_with("\x89PNG\r\n\x1a\n"); }

// Null where nothing is known to be wrong, also where it is neither a JPEG nor a PNG.
inline const char* imageFault(std::string_view bytes) {
  if (isJpeg(bytes)) return coded_image::isWholeJpeg(bytes) ? nullptr : "is cut off";
  return isPng(bytes) ? coded_image::pngFault(bytes) : nullptr;
}

}  // namespace waymark
