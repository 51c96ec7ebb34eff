// One frame as a preview message: reduced, as JPEG, with the squares in it that are no markers.
#pragma once

#include <cstddef>

#include "capture/jpeg_encoder.h"
#include "daemon/preview/preview_link.h"
#include "slam/detection/quads/quad_scanner.h"
#include "slam/detection/search/reduced_image.h"
#include <waymark/preview_t.hpp>

namespace waymark::daemon {

struct PreviewOptions {
  int max_width_px = 640;  // halved until it is no wider
  int quality = 60;        // of the JPEG, 1 to 100; less where it would be too large
  // LCM loses messages beyond 60 kB in the field, and squares take some of it.
  std::size_t max_jpeg_bytes = 52'000;
  std::size_t max_rejected = 64;
  // Smaller things are no squares that somebody would wonder about, pixels of the preview.
  double min_diagonal_px = 20.0;
};

class PreviewMaker {
 public:
  explicit PreviewMaker(const PreviewOptions& options = {}) : options_(options) {}

  // False when the image cannot be made small enough.
  [[nodiscard]] bool make(const PreviewLink::Query& frame, preview_t* message);

 private:
  [[nodiscard]] bool encode(const ImageView& small, preview_t* message);
  void findRejected(const PreviewLink::Query& frame, const ImageView& small, int factor,
                    preview_t* message);

  const PreviewOptions options_;
  slam::ImageReducer reducer_;
  slam::QuadScanner scanner_;
  capture::JpegEncoder jpeg_;
};

}  // namespace waymark::daemon
