#include "capture/jpeg_encoder.h"

#include <turbojpeg.h>

namespace waymark::capture {

struct JpegEncoder::Impl {
  tjhandle handle = tjInitCompress();
  unsigned char* bytes = nullptr;  // turbojpeg's own, which it makes larger as needed
  unsigned long size = 0;          // NOLINT(google-runtime-int): turbojpeg's type

  Impl() = default;
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    tjFree(bytes);
    if (handle != nullptr) tjDestroy(handle);
  }
};

JpegEncoder::JpegEncoder() : impl_(std::make_unique<Impl>()) {}
JpegEncoder::~JpegEncoder() = default;

std::span<const std::uint8_t> JpegEncoder::encode(const ImageView& image, int quality) {
  if (impl_->handle == nullptr ||
      tjCompress2(impl_->handle, image.data, image.width, static_cast<int>(image.stride),
                  image.height, TJPF_GRAY, &impl_->bytes, &impl_->size, TJSAMP_GRAY, quality,
                  TJFLAG_ACCURATEDCT) != 0) {
    return {};
  }
  return {impl_->bytes, impl_->size};
}

}  // namespace waymark::capture
