// The conversation on endpoint 0, without a host.
#include "tests/vm/uvc/uvc_device.h"

#include <gtest/gtest.h>
#include <linux/usb/ch9.h>
#include <linux/usb/video.h>

namespace waymark::testing {
namespace {

constexpr std::uint8_t kToHost = USB_DIR_IN;
constexpr std::uint8_t kClassToHost = USB_DIR_IN | USB_TYPE_CLASS | USB_RECIP_INTERFACE;
constexpr std::uint8_t kClassToDevice = USB_TYPE_CLASS | USB_RECIP_INTERFACE;

class UvcDeviceTest : public ::testing::TestWithParam<Transfer> {
 protected:
  std::optional<Bytes> standard(std::uint8_t type, std::uint8_t request, unsigned value,
                                unsigned index, unsigned length = 0) {
    return device_.handle({type, request, static_cast<std::uint16_t>(value),
                           static_cast<std::uint16_t>(index), static_cast<std::uint16_t>(length)},
                          {});
  }
  std::optional<Bytes> get(std::uint8_t request, unsigned selector, unsigned unit,
                           unsigned interface, unsigned length) {
    return standard(kClassToHost, request, selector << 8, unit << 8 | interface, length);
  }
  bool set(unsigned selector, unsigned unit, unsigned interface, const Bytes& sent) {
    const SetupPacket setup{kClassToDevice, UVC_SET_CUR, static_cast<std::uint16_t>(selector << 8),
                            static_cast<std::uint16_t>(unit << 8 | interface),
                            static_cast<std::uint16_t>(sent.size())};
    return device_.handle(setup, sent).has_value();
  }
  bool setExposureMode(int mode) {
    return set(UVC_CT_AE_MODE_CONTROL, kCameraTerminal, kControlInterface,
               {static_cast<std::uint8_t>(mode)});
  }
  bool setExposure(std::uint32_t value) {
    return set(UVC_CT_EXPOSURE_TIME_ABSOLUTE_CONTROL, kCameraTerminal, kControlInterface,
               ByteWriter().le32(value).take());
  }
  RequestError lastError() {
    const auto code = get(UVC_GET_CUR, UVC_VC_REQUEST_ERROR_CODE_CONTROL, 0, kControlInterface, 1);
    return static_cast<RequestError>(code->at(0));
  }
  // As the host does before it streams.
  bool propose(unsigned selector, unsigned format, unsigned frame, std::uint32_t interval) {
    ByteWriter writer;
    writer.le16(1).u8(format).u8(frame).le32(interval);
    return set(selector, 0, kStreamingInterface, writer.zeros(34 - writer.size()).take());
  }
  bool configure() { return standard(0, USB_REQ_SET_CONFIGURATION, 1, 0).has_value(); }

  UvcDevice device_{CameraIdentity{}, GetParam()};
};

TEST_P(UvcDeviceTest, AnswersAreNotLongerThanAskedFor) {
  const auto descriptor = [this](unsigned type, unsigned length) {
    return standard(kToHost, USB_REQ_GET_DESCRIPTOR, type << 8, 0, length);
  };
  EXPECT_EQ(descriptor(USB_DT_DEVICE, 8)->size(), 8U);
  EXPECT_EQ(descriptor(USB_DT_DEVICE, 64), deviceDescriptor({}));
  EXPECT_EQ(descriptor(USB_DT_CONFIG, 9)->size(), 9U);
  EXPECT_EQ(descriptor(USB_DT_CONFIG, 4096), configurationDescriptor(GetParam()));
  EXPECT_FALSE(descriptor(USB_DT_BOS, 5)) << "unknown ones are refused";
}

TEST_P(UvcDeviceTest, KeepsItsConfiguration) {
  EXPECT_EQ(standard(kToHost, USB_REQ_GET_CONFIGURATION, 0, 0, 1), Bytes{0});
  EXPECT_TRUE(configure());
  EXPECT_EQ(standard(kToHost, USB_REQ_GET_CONFIGURATION, 0, 0, 1), Bytes{1});
  EXPECT_FALSE(standard(0, USB_REQ_SET_CONFIGURATION, 2, 0));
}

TEST_P(UvcDeviceTest, ControlsKeepWhatTheyAreTold) {
  const auto gain = [this](std::uint8_t request) {
    return readLe16(*get(request, UVC_PU_GAIN_CONTROL, kProcessingUnit, kControlInterface, 2), 0);
  };
  EXPECT_EQ(gain(UVC_GET_MIN), 0);
  EXPECT_EQ(gain(UVC_GET_MAX), 255);
  EXPECT_EQ(gain(UVC_GET_CUR), gain(UVC_GET_DEF));
  EXPECT_TRUE(set(UVC_PU_GAIN_CONTROL, kProcessingUnit, kControlInterface, {200, 0}));
  EXPECT_EQ(gain(UVC_GET_CUR), 200);
  EXPECT_EQ(device_.controls().value(Control::kGain), 200);
  EXPECT_TRUE(set(UVC_PU_BRIGHTNESS_CONTROL, kProcessingUnit, kControlInterface, {0xf6, 0xff}));
  EXPECT_EQ(device_.controls().value(Control::kBrightness), -10);
  EXPECT_EQ(get(UVC_GET_INFO, UVC_PU_GAIN_CONTROL, kProcessingUnit, kControlInterface, 1),
            Bytes{3});
  EXPECT_EQ(get(UVC_GET_LEN, UVC_PU_GAIN_CONTROL, kProcessingUnit, kControlInterface, 2),
            (Bytes{2, 0}));
}

TEST_P(UvcDeviceTest, ExposureCanBeSetOnlyWhereItIsManual) {
  EXPECT_FALSE(setExposure(100));
  EXPECT_EQ(lastError(), RequestError::kWrongState);
  EXPECT_TRUE(setExposureMode(kExposureManual));
  EXPECT_TRUE(setExposure(100));
  EXPECT_EQ(lastError(), RequestError::kNone);
  EXPECT_EQ(device_.controls().value(Control::kExposureTime), 100);
}

TEST_P(UvcDeviceTest, RejectionsHaveReasons) {
  EXPECT_FALSE(set(UVC_PU_GAIN_CONTROL, kProcessingUnit, kControlInterface, {0, 1}));
  EXPECT_EQ(lastError(), RequestError::kOutOfRange);
  EXPECT_EQ(device_.controls().value(Control::kGain), rangeOf(Control::kGain).initial);
  EXPECT_FALSE(setExposureMode(kExposureManual | kExposureAuto));
  EXPECT_EQ(lastError(), RequestError::kOutOfRange);
  EXPECT_FALSE(get(UVC_GET_CUR, UVC_PU_GAMMA_CONTROL, kProcessingUnit, kControlInterface, 2));
  EXPECT_EQ(lastError(), RequestError::kInvalidControl);
  EXPECT_FALSE(get(UVC_GET_CUR, UVC_PU_GAIN_CONTROL, 9, kControlInterface, 2));
  EXPECT_EQ(lastError(), RequestError::kInvalidUnit);
  EXPECT_FALSE(get(0x99, UVC_PU_GAIN_CONTROL, kProcessingUnit, kControlInterface, 2));
  EXPECT_EQ(lastError(), RequestError::kInvalidRequest);
}

TEST_P(UvcDeviceTest, ProposalsAreAnsweredWithWhatThereIs) {
  EXPECT_TRUE(propose(UVC_VS_PROBE_CONTROL, 3, 2, 170'000));
  const auto answer = get(UVC_GET_CUR, UVC_VS_PROBE_CONTROL, 0, kStreamingInterface, 34);
  ASSERT_EQ(answer->size(), 34U);
  EXPECT_EQ(answer->at(2), 3);
  EXPECT_EQ(answer->at(3), 2);
  EXPECT_EQ(readLe32(*answer, 4), 166'666U);
  EXPECT_EQ(readLe32(*answer, 18), 320U * 240U);
  EXPECT_EQ(readLe32(*answer, 22), modeOf(3, 2, 1, GetParam())->max_payload_bytes);
  EXPECT_FALSE(propose(UVC_VS_PROBE_CONTROL, 4, 1, 333'333)) << "there is no such format";
  EXPECT_FALSE(device_.stream()) << "a proposal is no commitment";
}

INSTANTIATE_TEST_SUITE_P(Transfers, UvcDeviceTest,
                         ::testing::Values(Transfer::kIsochronous, Transfer::kBulk));

using IsochronousDevice = UvcDeviceTest;
INSTANTIATE_TEST_SUITE_P(Isochronous, IsochronousDevice, ::testing::Values(Transfer::kIsochronous));

TEST_P(IsochronousDevice, StreamsWhileItsInterfaceHasBandwidth) {
  ASSERT_TRUE(configure());
  EXPECT_TRUE(propose(UVC_VS_COMMIT_CONTROL, 3, 1, 333'333));
  EXPECT_FALSE(device_.stream());
  EXPECT_TRUE(standard(USB_RECIP_INTERFACE, USB_REQ_SET_INTERFACE, 1, kStreamingInterface));
  ASSERT_TRUE(device_.stream());
  EXPECT_EQ(*device_.stream(), *modeOf(3, 1, 333'333, Transfer::kIsochronous));
  EXPECT_TRUE(standard(USB_RECIP_INTERFACE, USB_REQ_SET_INTERFACE, 0, kStreamingInterface));
  EXPECT_FALSE(device_.stream());
  EXPECT_FALSE(standard(USB_RECIP_INTERFACE, USB_REQ_SET_INTERFACE, 2, kStreamingInterface));
}

using BulkDevice = UvcDeviceTest;
INSTANTIATE_TEST_SUITE_P(Bulk, BulkDevice, ::testing::Values(Transfer::kBulk));

TEST_P(BulkDevice, StreamsFromCommitToClearedHalt) {
  ASSERT_TRUE(configure());
  EXPECT_TRUE(propose(UVC_VS_COMMIT_CONTROL, 1, 1, 333'333));
  EXPECT_TRUE(device_.stream());
  EXPECT_TRUE(standard(USB_RECIP_ENDPOINT, USB_REQ_CLEAR_FEATURE, 0, kVideoEndpoint));
  EXPECT_FALSE(device_.stream());
}

}  // namespace
}  // namespace waymark::testing
