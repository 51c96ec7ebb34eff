#include "capture/jpeg_decoder.h"

#include <cstddef>
#include <string_view>

#include <turbojpeg.h>

#include "base/image_view.h"

namespace waymark::capture {
namespace {

constexpr std::uint8_t kMark = 0xff;
constexpr std::uint8_t kStart = 0xd8;
constexpr std::uint8_t kEnd = 0xd9;
constexpr std::size_t kMin = 4;  // bytes: both marks

bool beginsWithMark(std::span<const std::uint8_t> bytes) {
  return bytes.size() >= kMin && bytes[0] == kMark && bytes[1] == kStart;
}

// Drivers pad pictures with zeros, to words or to whole buffers. Empty without an end mark.
std::span<const std::uint8_t> withoutPadding(std::span<const std::uint8_t> bytes) {
  std::size_t size = bytes.size();
  while (size > 0 && bytes[size - 1] == 0) --size;
  if (size < kMin || bytes[size - 2] != kMark || bytes[size - 1] != kEnd) return {};
  return bytes.first(size);
}

// Many webcams put a few bytes between the last block and the end mark. The picture is whole.
bool isHarmless(std::string_view warning) {
  return warning.find("extraneous bytes before marker 0xd9") != std::string_view::npos;
}

struct Release {
  void operator()(void* handle) const { tjDestroy(handle); }
};
using Handle = std::unique_ptr<void, Release>;

std::optional<std::string> decodeWith(tjhandle handle, std::span<const std::uint8_t> picture,
                                      int width, int height, std::uint8_t* grey) {
  int found_width = 0;
  int found_height = 0;
  int subsampling = 0;
  int colours = 0;
  if (tjDecompressHeader3(handle, picture.data(), picture.size(), &found_width, &found_height,
                          &subsampling, &colours) != 0) {
    return std::string("JPEG header: ") + tjGetErrorStr2(handle);
  }
  if (found_width != width || found_height != height) {
    return "JPEG picture of " + sizeText(found_width, found_height) + " in a stream of " +
           sizeText(width, height);
  }
  if (tjDecompress2(handle, picture.data(), picture.size(), grey, width, width, height, TJPF_GRAY,
                    TJFLAG_ACCURATEDCT) != 0) {
    const std::string reason = tjGetErrorStr2(handle);
    if (!isHarmless(reason)) return "JPEG data: " + reason;
  }
  return {};
}

}  // namespace

struct JpegDecoder::Impl {
  Handle handle;
};

JpegDecoder::JpegDecoder() : impl_(std::make_unique<Impl>()) {}
JpegDecoder::~JpegDecoder() = default;

std::optional<std::string> JpegDecoder::decode(std::span<const std::uint8_t> bytes, int width,
                                               int height, std::uint8_t* grey) {
  if (!beginsWithMark(bytes)) return "JPEG picture without a start mark";
  const std::span<const std::uint8_t> picture = withoutPadding(bytes);
  if (picture.empty()) return "JPEG picture without an end mark";
  if (!impl_->handle) impl_->handle.reset(tjInitDecompress());
  if (!impl_->handle) return "there is no memory for a JPEG decoder";

  std::optional<std::string> reason = decodeWith(impl_->handle.get(), picture, width, height, grey);
  // The tables of a damaged picture stay in a decoder, and the next picture suffers from them.
  if (reason) impl_->handle.reset();
  return reason;
}

}  // namespace waymark::capture
