// One frame as a preview message: reduced, as JPEG, with the squares in it that are no markers.
#pragma once

#include <cstddef>

#include "base/image_view.h"
#include "daemon/preview/preview_image.h"
#include "daemon/preview/preview_link.h"
#include "slam/detection/quads/quad_scanner.h"
#include <waymark/preview_t.hpp>

namespace waymark::daemon {

struct PreviewOptions {
  PreviewImageOptions image;
  std::size_t max_rejected = 64;
  // Smaller things are no squares that somebody would wonder about, pixels of the preview.
  double min_diagonal_px = 20.0;
};

class PreviewMaker {
 public:
  explicit PreviewMaker(const PreviewOptions& options = {})
      : options_(options), image_(options.image) {}

  // False when the image cannot be made small enough.
  [[nodiscard]] bool make(const PreviewLink::Query& frame, preview_t* message);

 private:
  void findRejected(const PreviewLink::Query& frame, const ImageView& small, int factor,
                    preview_t* message);

  const PreviewOptions options_;
  PreviewImage image_;
  slam::QuadScanner scanner_;
};

}  // namespace waymark::daemon
