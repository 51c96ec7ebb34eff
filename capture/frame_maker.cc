#include "capture/frame_maker.h"

namespace waymark::capture {

FrameMaker::FrameMaker(const Format& format, int buffers)
    : format_(format),
      pool_(isGreyPlane(format.layout) ? FramePool(buffers)
                                       : FramePool(format.width, format.height, buffers)) {}

FramePtr FrameMaker::make(int index, std::span<const std::uint8_t> data, int dma_buf,
                          SourceCounters* counters) {
  if (!isWhole(data)) {
    ++counters->dropped_corrupt;
    return nullptr;
  }
  if (isGreyPlane(format_.layout)) {
    FramePtr frame = pool_.acquire(index);
    frame->show({data.data(), format_.width, format_.height, format_.stride}, dma_buf);
    return frame;
  }
  FramePtr frame = pool_.acquire();
  if (!frame) {
    ++counters->dropped_no_buffer;
  } else if (!convert(data, frame->pixels())) {
    ++counters->dropped_corrupt;
    frame.reset();
  } else if (format_.keep_jpeg && format_.layout == PixelLayout::kJpeg) {
    frame->keepJpeg(data);
  }
  return frame;
}

bool FrameMaker::isWhole(std::span<const std::uint8_t> data) const {
  if (format_.layout == PixelLayout::kJpeg) return true;  // the decoder knows
  const std::size_t least =
      static_cast<std::size_t>(format_.stride) * static_cast<std::size_t>(format_.height - 1) +
      bytesPerRow(format_.layout, format_.width);
  return data.size() >= least;
}

bool FrameMaker::convert(std::span<const std::uint8_t> data, std::uint8_t* grey) {
  if (format_.layout == PixelLayout::kJpeg) {
    return !jpeg_.decode(data, format_.width, format_.height, grey);
  }
  extractGrey(format_.layout, data.data(), format_.stride, format_.width, format_.height, grey);
  return true;
}

}  // namespace waymark::capture
