// Single pictures of MJPEG streams, decoded straight to grey. Cameras deliver torn and half
// pictures; they are rejected, not shown.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

namespace waymark::capture {

class JpegDecoder {
 public:
  JpegDecoder();
  ~JpegDecoder();
  JpegDecoder(const JpegDecoder&) = delete;
  JpegDecoder& operator=(const JpegDecoder&) = delete;

  // Decodes one picture, which may be followed by padding, into grey[height][width]. Why it cannot
  // be had, otherwise: no start or end mark, another size, data that are torn; then `grey` may have
  // been written to.
  [[nodiscard]] std::optional<std::string> decode(std::span<const std::uint8_t> bytes, int width,
                                                  int height, std::uint8_t* grey);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace waymark::capture
