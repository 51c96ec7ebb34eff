// An image that people look at, small enough for one message.
#pragma once

#include <cstddef>

#include "base/image_view.h"
#include "capture/jpeg_encoder.h"
#include "slam/detection/search/reduced_image.h"
#include <waymark/preview_t.hpp>

namespace waymark::daemon {

struct PreviewImageOptions {
  int max_width_px = 640;  // halved until it is no wider
  int quality = 60;        // of the JPEG, 1 to 100; less where it would be too large
  // LCM loses messages beyond 60 kB in the field, and squares take some of it.
  std::size_t max_jpeg_bytes = 52'000;
};

class PreviewImage {
 public:
  explicit PreviewImage(const PreviewImageOptions& options = {}) : options_(options) {}

  struct Reduced {
    ImageView image;
    int factor = 1;  // pixels of the frame along a side of one of its
  };
  // Valid until the next call, and as long as the frame.
  [[nodiscard]] Reduced reduce(const ImageView& frame);
  // Into the message. False when it cannot be made small enough.
  [[nodiscard]] bool encode(const ImageView& reduced, preview_t* message);

 private:
  const PreviewImageOptions options_;
  slam::ImageReducer reducer_;
  capture::JpegEncoder jpeg_;
};

}  // namespace waymark::daemon
