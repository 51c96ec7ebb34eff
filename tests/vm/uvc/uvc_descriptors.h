// What the test camera says of itself: a UVC 1.1 camera at high speed, with the controls and the
// pixel formats of an ordinary webcam, and GREY. Tests only.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tests/vm/uvc/bytes.h"

namespace waymark::testing {

enum class PixelFormat { kMjpeg, kYuyv, kGrey };

// What the host has chosen to receive.
struct StreamMode {
  PixelFormat format = PixelFormat::kMjpeg;
  int width = 0;                        // pixels
  int height = 0;                       // pixels
  std::uint32_t interval_100ns = 0;     // from one frame to the next
  std::uint32_t max_frame_bytes = 0;    // no frame is longer; those of GREY and YUYV are as long
  std::uint32_t max_payload_bytes = 0;  // of a packet or transfer, with its header
  friend bool operator==(const StreamMode&, const StreamMode&) = default;
};

// One way to the host. Webcams are isochronous; industrial cameras often use bulk transfers.
enum class Transfer { kIsochronous, kBulk };

struct CameraIdentity {
  std::uint16_t vendor_id = 0x1d6b;   // the Linux Foundation's, as gadgets have it
  std::uint16_t product_id = 0x0102;  // its "webcam gadget"
  std::string manufacturer = "Waymark";
  std::string product = "Test Camera";
  std::string serial = "0001";  // empty: the camera has none, as many cheap ones
};

// Numbers that descriptors and requests share.
inline constexpr std::uint8_t kControlInterface = 0;
inline constexpr std::uint8_t kStreamingInterface = 1;
inline constexpr std::uint8_t kCameraTerminal = 1;
inline constexpr std::uint8_t kProcessingUnit = 2;
inline constexpr std::uint8_t kOutputTerminal = 3;
inline constexpr std::uint8_t kVideoEndpoint = 0x81;  // to the host
inline constexpr std::uint8_t kConfiguration = 1;

// The formats and sizes on offer, in the order of their descriptors. Indices count from 1.
struct FrameSize {
  int width = 0;                               // pixels
  int height = 0;                              // pixels
  std::vector<std::uint32_t> intervals_100ns;  // the first one is the default
};
struct Format {
  PixelFormat format = PixelFormat::kMjpeg;
  std::vector<FrameSize> sizes;
};
[[nodiscard]] const std::vector<Format>& offeredFormats();

// The mode of these indices with the offered interval next to `interval_100ns`. Empty when there
// are no such indices.
[[nodiscard]] std::optional<StreamMode> modeOf(std::uint8_t format_index, std::uint8_t frame_index,
                                               std::uint32_t interval_100ns, Transfer transfer);

[[nodiscard]] Bytes deviceDescriptor(const CameraIdentity& identity);
[[nodiscard]] Bytes configurationDescriptor(Transfer transfer);
// Index 0 lists the languages; empty when there is no such string.
[[nodiscard]] std::optional<Bytes> stringDescriptor(const CameraIdentity& identity,
                                                    std::uint8_t index);

}  // namespace waymark::testing
