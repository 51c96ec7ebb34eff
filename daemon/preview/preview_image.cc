#include "daemon/preview/preview_image.h"

#include <cstdint>
#include <span>

namespace waymark::daemon {

PreviewImage::Reduced PreviewImage::reduce(const ImageView& frame) {
  int factor = 1;
  while (frame.width > factor * options_.max_width_px) factor *= 2;
  return {factor == 1 ? frame : reducer_.reduce(frame, factor), factor};
}

bool PreviewImage::encode(const ImageView& reduced, preview_t* message) {
  constexpr int kWorstQuality = 10;
  for (int quality = options_.quality; quality >= kWorstQuality; quality /= 2) {
    const std::span<const std::uint8_t> bytes = jpeg_.encode(reduced, quality);
    if (bytes.empty()) return false;
    if (bytes.size() > options_.max_jpeg_bytes) continue;
    message->jpeg.assign(bytes.begin(), bytes.end());
    message->size = static_cast<std::int32_t>(bytes.size());
    return true;
  }
  return false;
}

}  // namespace waymark::daemon
