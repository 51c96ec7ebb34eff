// From a camera's buffer to a frame: shown as it lies where its bytes are the grey picture, else
// converted into a buffer of our own.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "capture/frame.h"
#include "capture/frame_source.h"
#include "capture/jpeg_decoder.h"
#include "capture/pixel_layout.h"

namespace waymark::capture {

class FrameMaker {
 public:
  struct Format {
    PixelLayout layout = PixelLayout::kGrey8;
    int width = 0;              // pixels
    int height = 0;             // pixels
    std::ptrdiff_t stride = 0;  // bytes from one row to the next; of no meaning for JPEG
    bool keep_jpeg = false;     // beside the grey picture, for recordings
  };

  // As many frames of our own as the camera has buffers, or frames that show them.
  FrameMaker(const Format& format, int buffers);

  // `data` is what the camera left in its buffer `index`; dma_buf: the same memory, or -1. Null
  // when it is too short or torn, or when all our frames are out: then counted in *counters.
  [[nodiscard]] FramePtr make(int index, std::span<const std::uint8_t> data, int dma_buf,
                              SourceCounters* counters);

  // Is there still a frame that shows the camera's buffer `index`? It must not be filled again as
  // long as there is.
  [[nodiscard]] bool shows(int index) const {
    return isGreyPlane(format_.layout) && pool_.inUse(index);
  }

 private:
  [[nodiscard]] bool isWhole(std::span<const std::uint8_t> data) const;
  [[nodiscard]] bool convert(std::span<const std::uint8_t> data, std::uint8_t* grey);

  Format format_;
  FramePool pool_;
  JpegDecoder jpeg_;
};

}  // namespace waymark::capture
