// Frames as bot_core images in event logs, so that they come back as they were.
#pragma once

#include <cstdint>
#include <span>

#include <bot_core/image_t.hpp>

#include "base/image_view.h"
#include "base/result.h"
#include "capture/frame.h"

namespace waymark::capture {

// A frame in a message: the camera's own JPEG untouched where `jpeg` has it, else the grey picture
// without gaps between its rows. What a stamp has beyond the wall clock goes into the metadata
// (monotonic_ns, sequence, exposure_ns: 8 bytes each, big-endian).
void fillImage(const FrameStamp& stamp, const ImageView& image, std::span<const std::uint8_t> jpeg,
               bot_core::image_t* message);

// True when `data` begins as an encoded image does, whatever its channel is called.
[[nodiscard]] bool isImage(std::span<const std::uint8_t> data);

// Decodes and checks a message: sizes that fit together, a format that we can read. What of the
// stamp is not in the metadata (other programs' logs) is reckoned from utime and `sequence`.
[[nodiscard]] Status readImage(std::span<const std::uint8_t> data, std::uint64_t sequence,
                               bot_core::image_t* message, FrameStamp* stamp);

}  // namespace waymark::capture
