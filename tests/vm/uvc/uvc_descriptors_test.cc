// Walks through the bytes as a host does, with the structures of the kernel's public headers.
#include "tests/vm/uvc/uvc_descriptors.h"

#include <cstring>

#include <gtest/gtest.h>
#include <linux/usb/ch9.h>
#include <linux/usb/video.h>

namespace waymark::testing {
namespace {

// Cuts a chain of descriptors; fails where a length is 0 or leads beyond the end.
std::vector<ByteView> split(ByteView bytes) {
  std::vector<ByteView> descriptors;
  for (std::size_t at = 0; at < bytes.size(); at += descriptors.back().size()) {
    const std::size_t length = bytes[at];
    if (length < 2 || at + length > bytes.size()) {
      ADD_FAILURE() << "length " << length << " at " << at;
      break;
    }
    descriptors.push_back(bytes.subspan(at, length));
  }
  return descriptors;
}

template <typename T>
T as(ByteView descriptor) {
  T value;
  EXPECT_GE(descriptor.size(), sizeof value);
  std::memcpy(&value, descriptor.data(), sizeof value);
  return value;
}

// What lies between an interface's descriptor and the next one.
std::vector<ByteView> partsOf(ByteView configuration, unsigned interface, unsigned alternate) {
  std::vector<ByteView> parts;
  bool within = false;
  for (const ByteView d : split(configuration)) {
    if (d[1] == USB_DT_INTERFACE) within = d[2] == interface && d[3] == alternate;
    if (within) parts.push_back(d);
  }
  return parts;
}

// The class-specific ones of them, as their header's total length has it.
Bytes classSpecific(const std::vector<ByteView>& parts) {
  ByteWriter writer;
  for (const ByteView part : parts) {
    if (part[1] == USB_DT_CS_INTERFACE) writer.append(part);
  }
  return writer.take();
}

class Configuration : public ::testing::TestWithParam<Transfer> {
 protected:
  const Bytes bytes_ = configurationDescriptor(GetParam());
};

TEST_P(Configuration, TotalLengthsAreTrue) {
  const auto configuration = as<usb_config_descriptor>(bytes_);
  EXPECT_EQ(configuration.bLength, USB_DT_CONFIG_SIZE);
  EXPECT_EQ(configuration.wTotalLength, bytes_.size());
  EXPECT_EQ(configuration.bNumInterfaces, 2);

  const Bytes control = classSpecific(partsOf(bytes_, kControlInterface, 0));
  EXPECT_EQ(as<uvc_header_descriptor>(control).wTotalLength, control.size());
  EXPECT_EQ(as<uvc_header_descriptor>(control).bcdUVC, 0x0110);
  const Bytes streaming = classSpecific(partsOf(bytes_, kStreamingInterface, 0));
  EXPECT_EQ(as<uvc_input_header_descriptor>(streaming).wTotalLength, streaming.size());
}

TEST_P(Configuration, UnitsAreJoinedFromTheSensorToTheBus) {
  const Bytes control = classSpecific(partsOf(bytes_, kControlInterface, 0));
  const std::vector<ByteView> units = split(control);
  ASSERT_EQ(units.size(), 4U);
  const auto camera = as<uvc_input_terminal_descriptor>(units[1]);
  EXPECT_EQ(units[1][2], UVC_VC_INPUT_TERMINAL);
  EXPECT_EQ(camera.wTerminalType, UVC_ITT_CAMERA);
  EXPECT_EQ(units[1].size(), std::size_t{UVC_DT_CAMERA_TERMINAL_SIZE(3)});
  EXPECT_EQ(units[2][2], UVC_VC_PROCESSING_UNIT);
  EXPECT_EQ(units[2].size(), std::size_t{UVC_DT_PROCESSING_UNIT_SIZE(2)});
  EXPECT_EQ(units[2][3], kProcessingUnit);
  EXPECT_EQ(units[2][4], camera.bTerminalID);
  const auto output = as<uvc_output_terminal_descriptor>(units[3]);
  EXPECT_EQ(output.bSourceID, kProcessingUnit);

  const Bytes streaming = classSpecific(partsOf(bytes_, kStreamingInterface, 0));
  EXPECT_EQ(as<uvc_input_header_descriptor>(streaming).bTerminalLink, output.bTerminalID);
}

TEST_P(Configuration, FormatsAndSizesAreNumberedFromOne) {
  const Bytes streaming = classSpecific(partsOf(bytes_, kStreamingInterface, 0));
  unsigned formats = 0;
  unsigned sizes = 0;
  unsigned promised = 0;
  for (const ByteView d : split(streaming)) {
    if (d[2] == UVC_VS_FORMAT_MJPEG || d[2] == UVC_VS_FORMAT_UNCOMPRESSED) {
      EXPECT_EQ(sizes, promised);
      EXPECT_EQ(d[3], ++formats);
      sizes = 0;
      promised = d[4];
    }
    if (d[2] != UVC_VS_FRAME_MJPEG && d[2] != UVC_VS_FRAME_UNCOMPRESSED) continue;
    const auto frame = as<uvc_frame_uncompressed>(d);
    EXPECT_EQ(frame.bFrameIndex, ++sizes);
    EXPECT_EQ(d.size(), std::size_t{26} + 4U * frame.bFrameIntervalType);

    const auto mode = modeOf(static_cast<std::uint8_t>(formats), frame.bFrameIndex,
                             frame.dwDefaultFrameInterval, GetParam());
    ASSERT_TRUE(mode);
    EXPECT_EQ(mode->width, frame.wWidth);
    EXPECT_EQ(mode->height, frame.wHeight);
    EXPECT_EQ(mode->max_frame_bytes, frame.dwMaxVideoFrameBufferSize);
    EXPECT_EQ(mode->interval_100ns, frame.dwDefaultFrameInterval);
  }
  EXPECT_EQ(sizes, promised);
  EXPECT_EQ(formats, 3U);
  EXPECT_EQ(as<uvc_input_header_descriptor>(streaming).bNumFormats, 3);
}

INSTANTIATE_TEST_SUITE_P(Transfers, Configuration,
                         ::testing::Values(Transfer::kIsochronous, Transfer::kBulk));

TEST(Endpoint, IsochronousVideoHasASettingWithoutBandwidth) {
  const Bytes bytes = configurationDescriptor(Transfer::kIsochronous);
  EXPECT_EQ(partsOf(bytes, kStreamingInterface, 0).front()[4], 0) << "no endpoint at rest";
  const auto streaming = partsOf(bytes, kStreamingInterface, 1);
  ASSERT_EQ(streaming.size(), 2U);
  const ByteView endpoint = streaming[1];
  ASSERT_EQ(endpoint.size(), std::size_t{USB_DT_ENDPOINT_SIZE});
  EXPECT_EQ(endpoint[2], kVideoEndpoint);
  EXPECT_EQ(endpoint[3] & USB_ENDPOINT_XFERTYPE_MASK, USB_ENDPOINT_XFER_ISOC);
  const unsigned size = readLe16(endpoint, 4);
  const unsigned bytes_per_microframe = (size & 0x7ff) * (1 + (size >> 11 & 3));
  EXPECT_EQ(modeOf(1, 1, 1, Transfer::kIsochronous)->max_payload_bytes, bytes_per_microframe);
}

TEST(Endpoint, BulkVideoIsAlwaysThere) {
  const Bytes bytes = configurationDescriptor(Transfer::kBulk);
  EXPECT_TRUE(partsOf(bytes, kStreamingInterface, 1).empty());
  const ByteView endpoint = partsOf(bytes, kStreamingInterface, 0).back();
  EXPECT_EQ(endpoint[1], USB_DT_ENDPOINT);
  EXPECT_EQ(endpoint[3] & USB_ENDPOINT_XFERTYPE_MASK, USB_ENDPOINT_XFER_BULK);
  EXPECT_EQ(readLe16(endpoint, 4), 512);
}

TEST(Modes, TheNextIntervalIsTaken) {
  EXPECT_EQ(modeOf(1, 1, 400'000, Transfer::kBulk)->interval_100ns, 333'333U);
  EXPECT_EQ(modeOf(1, 1, 600'000, Transfer::kBulk)->interval_100ns, 666'666U);
  EXPECT_EQ(modeOf(3, 1, 1, Transfer::kBulk)->interval_100ns, 166'666U);
  for (const auto& [format, frame] : {std::pair{0, 1}, {4, 1}, {1, 0}, {1, 3}}) {
    EXPECT_FALSE(modeOf(static_cast<std::uint8_t>(format), static_cast<std::uint8_t>(frame),
                        333'333, Transfer::kBulk));
  }
}

TEST(Identity, CamerasMayHaveASerialNumberOrNone) {
  CameraIdentity identity;
  identity.serial = "A7";
  auto device = as<usb_device_descriptor>(deviceDescriptor(identity));
  EXPECT_EQ(device.bLength, USB_DT_DEVICE_SIZE);
  EXPECT_EQ(device.idVendor, identity.vendor_id);
  EXPECT_EQ(device.idProduct, identity.product_id);
  EXPECT_EQ(stringDescriptor(identity, device.iSerialNumber),
            (Bytes{6, USB_DT_STRING, 'A', 0, '7', 0}));
  EXPECT_EQ(stringDescriptor(identity, 0), (Bytes{4, USB_DT_STRING, 0x09, 0x04}));
  EXPECT_TRUE(stringDescriptor(identity, device.iManufacturer));
  EXPECT_TRUE(stringDescriptor(identity, device.iProduct));
  EXPECT_FALSE(stringDescriptor(identity, 9));

  identity.serial.clear();
  device = as<usb_device_descriptor>(deviceDescriptor(identity));
  EXPECT_EQ(device.iSerialNumber, 0);
  EXPECT_FALSE(stringDescriptor(identity, 3));
}

}  // namespace
}  // namespace waymark::testing
