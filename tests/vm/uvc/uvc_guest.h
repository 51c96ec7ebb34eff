// What tests with the test camera have in common inside the guest. Tests only.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "tests/vm/uvc/uvc_camera.h"

namespace waymark::testing {

// For the beginning of a test: vhci-hcd and uvcvideo are loaded, and as if just loaded; nothing is
// plugged in. Empty when it is so, else what went wrong.
[[nodiscard]] std::string prepareUvcGuest();

// Whether uvcvideo keeps frames that it knows to be faulty from the reader, as it does if nobody
// says otherwise, or marks them. For cameras plugged in from now on.
[[nodiscard]] bool setDriverDropsFaultyFrames(bool drops);

// A frame of the mode that carries its index: of GREY and YUYV every byte, of MJPEG as many as a
// picture of that size would have, between the marks of a JPEG. Different for different `camera`s.
[[nodiscard]] Bytes numberedFrame(const StreamMode& mode, std::uint64_t index, int camera = 0);
// The index that the frame's bytes begin with; empty when it is not whole, byte for byte.
[[nodiscard]] std::optional<std::uint64_t> indexOf(ByteView frame, const StreamMode& mode,
                                                   int camera = 0);

// A camera of such frames.
[[nodiscard]] CameraOptions numberedCamera(Transfer transfer = Transfer::kIsochronous,
                                           int camera = 0);

// The mode as the reader asks for it.
[[nodiscard]] StreamMode streamMode(PixelFormat format, int width, int height, int rate_hz,
                                    Transfer transfer = Transfer::kIsochronous);

}  // namespace waymark::testing
