#include "tests/vm/uvc/uvc_payload.h"

#include <algorithm>

#include <linux/usb/video.h>

namespace waymark::testing {
namespace {

// Long enough to meet entropy-coded data that cannot be, short enough to hide in a large image.
constexpr std::size_t kGarbledBytes = 256;

// The same bytes for every frame. None is the frame's own: each differs in its highest bit.
void garble(Bytes* frame) {
  const std::size_t begin = frame->size() / 2;
  const std::size_t end = std::min(frame->size(), begin + kGarbledBytes);
  std::uint32_t state = 1;
  for (std::size_t i = begin; i < end; ++i) {
    state = state * 1664525 + 1013904223;  // a linear congruence, as in Numerical Recipes
    const std::uint8_t own = (*frame)[i];
    (*frame)[i] = static_cast<std::uint8_t>((own ^ 0x80) & 0x80) | (state >> 25);
  }
}

}  // namespace

Bytes damaged(Bytes frame, Fault fault) {
  if (fault == Fault::kShort) frame.resize(frame.size() / 2);
  if (fault == Fault::kGarbled) garble(&frame);
  return frame;
}

std::vector<Bytes> cutIntoPayloads(ByteView frame, std::size_t max_payload_bytes, bool frame_id,
                                   bool error) {
  const std::size_t room = max_payload_bytes - kPayloadHeaderBytes;
  const unsigned flags =
      UVC_STREAM_EOH | (frame_id ? UVC_STREAM_FID : 0U) | (error ? UVC_STREAM_ERR : 0U);
  std::vector<Bytes> payloads;
  for (std::size_t at = 0; at < frame.size(); at += room) {
    const std::size_t count = std::min(room, frame.size() - at);
    const bool last = at + count == frame.size();
    ByteWriter writer;
    writer.u8(kPayloadHeaderBytes).u8(flags | (last ? UVC_STREAM_EOF : 0U));
    payloads.push_back(writer.append(frame.subspan(at, count)).take());
  }
  return payloads;
}

}  // namespace waymark::testing
