#include "tests/vm/uvc/uvc_descriptors.h"

#include <algorithm>
#include <array>
#include <cstdlib>

#include <linux/usb/ch9.h>
#include <linux/usb/video.h>

namespace waymark::testing {
namespace {

constexpr unsigned kUsbVersion = 0x0200;
constexpr unsigned kUvcVersion = 0x0110;
constexpr std::uint32_t kClock_hz = 48'000'000;
constexpr std::uint32_t k30Hz = 333'333;  // intervals, in units of 100 ns
constexpr std::uint32_t k15Hz = 666'666;
constexpr std::uint32_t k60Hz = 166'666;
constexpr std::uint32_t k5Hz = 2'000'000;  // what an emulated machine can work on

// An isochronous endpoint at high speed carries at most three packets of 1024 bytes in each of the
// 8,000 microframes of a second; bits 11 and 12 say how many there are beyond the first.
constexpr unsigned kIsoPacketBytes = 1024;
constexpr unsigned kIsoPacketsPerMicroframe = 3;
constexpr unsigned kBulkPacketBytes = 512;
// The driver's bulk transfers are of at most 32 packets. A payload is one transfer.
constexpr unsigned kBulkPayloadBytes = 32 * kBulkPacketBytes;

// String indices.
constexpr std::uint8_t kManufacturerString = 1;
constexpr std::uint8_t kProductString = 2;
constexpr std::uint8_t kSerialString = 3;
constexpr unsigned kEnglish = 0x0409;

unsigned bitsPerPixel(PixelFormat format) { return format == PixelFormat::kGrey ? 8 : 16; }

// A JPEG of that size needs less than two bytes for a pixel.
std::uint32_t maxFrameBytes(PixelFormat format, const FrameSize& size) {
  return static_cast<std::uint32_t>(size.width * size.height) * bitsPerPixel(format) / 8;
}

std::uint32_t maxPayloadBytes(Transfer transfer) {
  return transfer == Transfer::kBulk ? kBulkPayloadBytes
                                     : kIsoPacketsPerMicroframe * kIsoPacketBytes;
}

// The GUIDs of uncompressed formats are their four letters and always the same rest.
std::array<std::uint8_t, 16> formatGuid(PixelFormat format) {
  const char* letters = format == PixelFormat::kGrey ? "Y800" : "YUY2";
  std::array<std::uint8_t, 16> guid = {0,    0,    0,    0,    0x00, 0x00, 0x10, 0x00,
                                       0x80, 0x00, 0x00, 0xaa, 0x00, 0x38, 0x9b, 0x71};
  std::copy_n(letters, 4, guid.begin());
  return guid;
}

// A descriptor's first three bytes; `length` counts them.
ByteWriter& beginInterfacePart(unsigned length, unsigned subtype, ByteWriter* writer) {
  return writer->u8(length).u8(USB_DT_CS_INTERFACE).u8(subtype);
}

void appendInterface(unsigned number, unsigned alternate, unsigned endpoints, unsigned subclass,
                     ByteWriter* writer) {
  writer->u8(USB_DT_INTERFACE_SIZE).u8(USB_DT_INTERFACE).u8(number).u8(alternate).u8(endpoints);
  writer->u8(USB_CLASS_VIDEO).u8(subclass).u8(UVC_PC_PROTOCOL_UNDEFINED).u8(0);
}

void appendEndpoint(unsigned attributes, unsigned max_packet, unsigned interval,
                    ByteWriter* writer) {
  writer->u8(USB_DT_ENDPOINT_SIZE).u8(USB_DT_ENDPOINT).u8(kVideoEndpoint).u8(attributes);
  writer->le16(max_packet).u8(interval);
}

// Camera terminal -> processing unit -> output terminal. The bits of bmControls are those of the
// table in uvc_controls.cc.
Bytes unitDescriptors() {
  ByteWriter writer;
  beginInterfacePart(UVC_DT_CAMERA_TERMINAL_SIZE(3), UVC_VC_INPUT_TERMINAL, &writer);
  writer.u8(kCameraTerminal).le16(UVC_ITT_CAMERA).u8(0).u8(0);
  writer.le16(0).le16(0).le16(0);                         // focal lengths: no zoom
  writer.u8(3).u8(1 << 1 | 1 << 2 | 1 << 3).u8(0).u8(0);  // exposure: mode, priority, time

  beginInterfacePart(UVC_DT_PROCESSING_UNIT_SIZE(2), UVC_VC_PROCESSING_UNIT, &writer);
  writer.u8(kProcessingUnit).u8(kCameraTerminal).le16(0);
  // Brightness and white balance temperature; gain, power line frequency, white balance mode.
  writer.u8(2).u8(1 << 0 | 1 << 6).u8(1 << 1 | 1 << 2 | 1 << 4).u8(0).u8(0);

  beginInterfacePart(UVC_DT_OUTPUT_TERMINAL_SIZE, UVC_VC_OUTPUT_TERMINAL, &writer);
  writer.u8(kOutputTerminal).le16(UVC_TT_STREAMING).u8(0).u8(kProcessingUnit).u8(0);
  return writer.take();
}

void appendControlInterface(ByteWriter* writer) {
  appendInterface(kControlInterface, 0, 0, UVC_SC_VIDEOCONTROL, writer);
  const Bytes units = unitDescriptors();
  constexpr unsigned kHeaderLength = UVC_DT_HEADER_SIZE(1);
  beginInterfacePart(kHeaderLength, UVC_VC_HEADER, writer).le16(kUvcVersion);
  writer->le16(kHeaderLength + static_cast<unsigned>(units.size())).le32(kClock_hz);
  writer->u8(1).u8(kStreamingInterface).append(units);
}

void appendFormat(unsigned index, const Format& format, ByteWriter* writer) {
  const auto sizes = static_cast<unsigned>(format.sizes.size());
  if (format.format == PixelFormat::kMjpeg) {
    beginInterfacePart(UVC_DT_FORMAT_MJPEG_SIZE, UVC_VS_FORMAT_MJPEG, writer);
    writer->u8(index).u8(sizes).u8(0);
  } else {
    beginInterfacePart(UVC_DT_FORMAT_UNCOMPRESSED_SIZE, UVC_VS_FORMAT_UNCOMPRESSED, writer);
    writer->u8(index).u8(sizes).append(formatGuid(format.format)).u8(bitsPerPixel(format.format));
  }
  writer->u8(1);                    // default size
  writer->u8(0).u8(0).u8(0).u8(0);  // aspect ratio, interlacing, copy protection
}

void appendSize(unsigned index, PixelFormat format, const FrameSize& size, ByteWriter* writer) {
  const auto intervals = static_cast<unsigned>(size.intervals_100ns.size());
  const std::uint32_t bytes = maxFrameBytes(format, size);
  const auto [shortest, longest] = std::ranges::minmax(size.intervals_100ns);
  const auto bitRate = [bytes](std::uint32_t interval_100ns) {
    return static_cast<std::uint32_t>(8ULL * bytes * 10'000'000 / interval_100ns);
  };
  const bool jpeg = format == PixelFormat::kMjpeg;
  beginInterfacePart(UVC_DT_FRAME_UNCOMPRESSED_SIZE(intervals),
                     jpeg ? UVC_VS_FRAME_MJPEG : UVC_VS_FRAME_UNCOMPRESSED, writer);
  writer->u8(index).u8(0);
  writer->le16(static_cast<unsigned>(size.width)).le16(static_cast<unsigned>(size.height));
  writer->le32(bitRate(longest)).le32(bitRate(shortest)).le32(bytes);
  writer->le32(size.intervals_100ns.front()).u8(intervals);
  for (const std::uint32_t interval : size.intervals_100ns) writer->le32(interval);
}

Bytes formatDescriptors() {
  ByteWriter writer;
  unsigned format_index = 0;
  for (const Format& format : offeredFormats()) {
    appendFormat(++format_index, format, &writer);
    unsigned size_index = 0;
    for (const FrameSize& size : format.sizes) {
      appendSize(++size_index, format.format, size, &writer);
    }
    beginInterfacePart(UVC_DT_COLOR_MATCHING_SIZE, UVC_VS_COLORFORMAT, &writer);
    writer.u8(UVC_COLOR_PRIMARIES_BT_709_SRGB);
    writer.u8(UVC_TRANSFER_CHARACTERISTICS_BT_709).u8(UVC_MATRIX_COEFFICIENTS_SMPTE_170M);
  }
  return writer.take();
}

void appendStreamingInterface(Transfer transfer, ByteWriter* writer) {
  const bool bulk = transfer == Transfer::kBulk;
  appendInterface(kStreamingInterface, 0, bulk ? 1 : 0, UVC_SC_VIDEOSTREAMING, writer);
  const auto format_count = static_cast<unsigned>(offeredFormats().size());
  const Bytes formats = formatDescriptors();
  const unsigned header_length = UVC_DT_INPUT_HEADER_SIZE(format_count, 1);
  beginInterfacePart(header_length, UVC_VS_INPUT_HEADER, writer).u8(format_count);
  writer->le16(header_length + static_cast<unsigned>(formats.size())).u8(kVideoEndpoint);
  writer->u8(0).u8(kOutputTerminal);
  writer->u8(0).u8(0).u8(0);          // no still pictures, no button
  writer->u8(1).zeros(format_count);  // no controls of a format's own
  writer->append(formats);
  if (bulk) {
    appendEndpoint(USB_ENDPOINT_XFER_BULK, kBulkPacketBytes, 0, writer);
  } else {
    // At rest (0) the interface takes no bandwidth.
    appendInterface(kStreamingInterface, 1, 1, UVC_SC_VIDEOSTREAMING, writer);
    appendEndpoint(USB_ENDPOINT_XFER_ISOC | USB_ENDPOINT_SYNC_ASYNC,
                   kIsoPacketBytes | (kIsoPacketsPerMicroframe - 1) << 11, 1, writer);
  }
}

void appendAssociation(ByteWriter* writer) {
  writer->u8(USB_DT_INTERFACE_ASSOCIATION_SIZE).u8(USB_DT_INTERFACE_ASSOCIATION);
  writer->u8(kControlInterface).u8(2).u8(USB_CLASS_VIDEO);
  writer->u8(UVC_SC_VIDEO_INTERFACE_COLLECTION).u8(UVC_PC_PROTOCOL_UNDEFINED).u8(kProductString);
}

}  // namespace

const std::vector<Format>& offeredFormats() {
  static const std::vector<Format> formats = {
      {PixelFormat::kMjpeg, {{1280, 720, {k30Hz, k15Hz}}, {640, 480, {k30Hz, k15Hz, k5Hz, k60Hz}}}},
      {PixelFormat::kYuyv, {{640, 480, {k30Hz, k15Hz, k5Hz}}, {320, 240, {k30Hz, k15Hz, k60Hz}}}},
      {PixelFormat::kGrey,
       {{640, 480, {k30Hz, k15Hz, k5Hz, k60Hz}}, {320, 240, {k30Hz, k15Hz, k60Hz}}}},
  };
  return formats;
}

std::optional<StreamMode> modeOf(std::uint8_t format_index, std::uint8_t frame_index,
                                 std::uint32_t interval_100ns, Transfer transfer) {
  const std::vector<Format>& formats = offeredFormats();
  if (format_index < 1 || format_index > formats.size()) return std::nullopt;
  const Format& format = formats[format_index - 1U];
  if (frame_index < 1 || frame_index > format.sizes.size()) return std::nullopt;
  const FrameSize& size = format.sizes[frame_index - 1U];
  const auto distance = [interval_100ns](std::uint32_t offered) {
    return std::abs(static_cast<std::int64_t>(offered) - static_cast<std::int64_t>(interval_100ns));
  };
  const std::uint32_t interval = *std::ranges::min_element(size.intervals_100ns, {}, distance);
  return StreamMode{format.format,
                    size.width,
                    size.height,
                    interval,
                    maxFrameBytes(format.format, size),
                    maxPayloadBytes(transfer)};
}

Bytes deviceDescriptor(const CameraIdentity& identity) {
  ByteWriter writer;
  writer.u8(USB_DT_DEVICE_SIZE).u8(USB_DT_DEVICE).le16(kUsbVersion);
  writer.u8(USB_CLASS_MISC).u8(2).u8(1);  // its interfaces are associated
  writer.u8(64).le16(identity.vendor_id).le16(identity.product_id).le16(0x0100);
  writer.u8(kManufacturerString).u8(kProductString);
  writer.u8(identity.serial.empty() ? 0 : kSerialString).u8(1);
  return writer.take();
}

Bytes configurationDescriptor(Transfer transfer) {
  ByteWriter interfaces;
  appendAssociation(&interfaces);
  appendControlInterface(&interfaces);
  appendStreamingInterface(transfer, &interfaces);

  ByteWriter writer;
  writer.u8(USB_DT_CONFIG_SIZE).u8(USB_DT_CONFIG);
  writer.le16(USB_DT_CONFIG_SIZE + static_cast<unsigned>(interfaces.size()));
  writer.u8(2).u8(kConfiguration).u8(0).u8(USB_CONFIG_ATT_ONE).u8(250);  // 500 mA
  writer.append(interfaces.take());
  return writer.take();
}

std::optional<Bytes> stringDescriptor(const CameraIdentity& identity, std::uint8_t index) {
  ByteWriter writer;
  if (index == 0) return writer.u8(4).u8(USB_DT_STRING).le16(kEnglish).take();
  const std::string* text = nullptr;
  if (index == kManufacturerString) text = &identity.manufacturer;
  if (index == kProductString) text = &identity.product;
  if (index == kSerialString && !identity.serial.empty()) text = &identity.serial;
  if (text == nullptr) return std::nullopt;
  writer.u8(2 + 2 * static_cast<unsigned>(text->size())).u8(USB_DT_STRING);
  for (const char letter : *text) writer.le16(static_cast<unsigned char>(letter));  // ASCII
  return writer.take();
}

}  // namespace waymark::testing
