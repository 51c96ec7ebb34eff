// Grey pictures as JPEG, for recordings that must be small.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "base/image_view.h"

namespace waymark::capture {

class JpegEncoder {
 public:
  JpegEncoder();
  ~JpegEncoder();
  JpegEncoder(const JpegEncoder&) = delete;
  JpegEncoder& operator=(const JpegEncoder&) = delete;

  // quality: 1 to 100. The bytes are good until the next call. Empty when it cannot be done.
  [[nodiscard]] std::span<const std::uint8_t> encode(const ImageView& image, int quality);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace waymark::capture
