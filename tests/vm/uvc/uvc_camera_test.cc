// The camera with its thread and its socket, streaming to a host that is made of software as well.
#include "tests/vm/uvc/uvc_camera.h"

#include <memory>
#include <numeric>
#include <stdexcept>

#include <gtest/gtest.h>
#include <linux/usb/ch9.h>
#include <linux/usb/video.h>
#include <sys/socket.h>

#include "tests/vm/uvc/uvc_payload.h"
#include "tests/vm/uvc/virtual_host.h"

namespace waymark::testing {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr std::uint32_t k60Hz = 166'666;  // units of 100 ns
constexpr int kSmallGrey = 320 * 240;

// Every frame is other bytes, and not a multiple of any payload.
Bytes pattern(std::size_t count, std::uint64_t index) {
  Bytes bytes(count);
  std::iota(bytes.begin(), bytes.end(), static_cast<std::uint8_t>(17 * index));
  return bytes;
}

TEST(Payloads, JoinedTheyAreTheFrame) {
  const Bytes frame = pattern(1000, 1);
  for (const std::size_t size : {3U, 102U, 1001U, 1002U, 5000U}) {
    const std::vector<Bytes> payloads = cutIntoPayloads(frame, size, true, false);
    Bytes joined;
    for (const Bytes& payload : payloads) {
      ASSERT_LE(payload.size(), size);
      EXPECT_EQ(payload[0], 2);
      const unsigned end = &payload == &payloads.back() ? UVC_STREAM_EOF : 0;
      EXPECT_EQ(payload[1], UVC_STREAM_EOH | UVC_STREAM_FID | end);
      joined.insert(joined.end(), payload.begin() + 2, payload.end());
    }
    EXPECT_EQ(joined, frame);
  }
  EXPECT_EQ(cutIntoPayloads(frame, 102, true, false).size(), 10U);
}

TEST(Payloads, AFaultyFrameSaysSoInEveryPayload) {
  for (const Bytes& payload : cutIntoPayloads(pattern(1000, 1), 102, false, true)) {
    EXPECT_NE(payload[1] & UVC_STREAM_ERR, 0);
    EXPECT_EQ(payload[1] & UVC_STREAM_FID, 0);
  }
}

TEST(Damage, IsWhatItsNameSays) {
  const Bytes frame = pattern(10'000, 1);
  EXPECT_EQ(damaged(frame, Fault::kNone), frame);
  EXPECT_EQ(damaged(frame, Fault::kErrorBit), frame);
  EXPECT_EQ(damaged(frame, Fault::kShort), Bytes(frame.begin(), frame.begin() + 5000));
  const Bytes garbled = damaged(frame, Fault::kGarbled);
  ASSERT_EQ(garbled.size(), frame.size());
  int different = 0;
  for (std::size_t i = 0; i < frame.size(); ++i) different += garbled[i] != frame[i] ? 1 : 0;
  EXPECT_EQ(different, 256);
}

class UvcCameraTest : public ::testing::TestWithParam<Transfer> {
 protected:
  void plugIn() {
    int ends[2];
    ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0);
    camera_.connect(UniqueFd(ends[0]));
    host_ = std::make_unique<VirtualHost>(UniqueFd(ends[1]), GetParam());
  }
  void SetUp() override { plugIn(); }

  static Bytes greyFrame(std::uint64_t index) { return pattern(kSmallGrey, index); }

  static CameraOptions options() {
    CameraOptions options;
    options.transfer = GetParam();
    options.frames = [](const StreamMode& mode, std::uint64_t index) {
      return pattern(mode.max_frame_bytes, index);
    };
    return options;
  }

  UvcCamera camera_{options()};
  std::unique_ptr<VirtualHost> host_;
};

TEST_P(UvcCameraTest, FramesArriveAsTheyWereGiven) {
  host_->startStream(3, 2, k60Hz);
  bool frame_id = false;
  const auto began = steady_clock::now();
  constexpr int kFrames = 20;
  for (int i = 0; i < kFrames; ++i) {
    const ReceivedFrame frame = host_->receiveFrame();
    // A host that is late makes the camera skip frames; the next one it makes is the next index.
    ASSERT_EQ(frame.bytes, greyFrame(static_cast<std::uint64_t>(i))) << i;
    EXPECT_NE(frame.frame_id, frame_id) << "it tells frames apart";
    frame_id = frame.frame_id;
    EXPECT_FALSE(frame.error);
  }
  EXPECT_GE(steady_clock::now() - began, milliseconds((kFrames - 3) * 1000 / 60)) << "its pace";
  EXPECT_TRUE(
      camera_.waitFor([](const CameraState& s) { return s.sent >= kFrames; }, milliseconds(5000)));
  EXPECT_EQ(camera_.state().stream, modeOf(3, 2, k60Hz, GetParam()));
}

TEST_P(UvcCameraTest, StopsAndStreamsAgain) {
  // On a busy computer the next frame may have answered all transfers before they are taken back.
  int taken_back = 0;
  for (int attempt = 0; attempt < 20 && taken_back == 0; ++attempt) {
    const std::uint64_t next = camera_.state().asked;
    host_->startStream(3, 2, k60Hz);
    EXPECT_EQ(host_->receiveFrame().bytes, greyFrame(next));
    taken_back = host_->stopStream();
    EXPECT_TRUE(
        camera_.waitFor([](const CameraState& s) { return !s.stream; }, milliseconds(5000)));
  }
  EXPECT_GT(taken_back, 0) << "transfers were waiting, and came back";
  const std::uint64_t asked = camera_.state().asked;
  std::this_thread::sleep_for(milliseconds(60));
  EXPECT_EQ(camera_.state().asked, asked) << "nobody receives";

  host_->startStream(2, 2, k60Hz);
  EXPECT_EQ(host_->receiveFrame().bytes, pattern(2 * kSmallGrey, asked));
}

TEST_P(UvcCameraTest, DamagesAsManyFramesAsAsked) {
  camera_.damage(Fault::kShort, 2);
  host_->startStream(3, 2, k60Hz);
  EXPECT_EQ(host_->receiveFrame().bytes, damaged(greyFrame(0), Fault::kShort));
  EXPECT_EQ(host_->receiveFrame().bytes, damaged(greyFrame(1), Fault::kShort));
  EXPECT_EQ(host_->receiveFrame().bytes, greyFrame(2));
  EXPECT_TRUE(
      camera_.waitFor([](const CameraState& s) { return s.damaged == 2; }, milliseconds(5000)));

  camera_.damage(Fault::kErrorBit, 1);
  int faulty = 0;
  for (int i = 0; i < 10; ++i) faulty += host_->receiveFrame().error ? 1 : 0;
  EXPECT_EQ(faulty, 1);
}

TEST_P(UvcCameraTest, SilenceEnds) {
  host_->startStream(3, 2, k60Hz);
  (void)host_->receiveFrame();
  camera_.fallSilent(milliseconds(300));
  const auto began = steady_clock::now();
  auto longest = steady_clock::duration::zero();
  auto last = began;
  while (steady_clock::now() - began < milliseconds(600)) {
    (void)host_->receiveFrame();
    const auto now = steady_clock::now();
    longest = std::max(longest, now - last);
    last = now;
  }
  EXPECT_GE(longest, milliseconds(250));
}

TEST_P(UvcCameraTest, APulledPlugEndsTheConversation) {
  host_->startStream(3, 2, k60Hz);
  (void)host_->receiveFrame();
  camera_.unplug();
  EXPECT_FALSE(camera_.state().connected);
  EXPECT_THROW(
      {
        while (true) (void)host_->receiveFrame();
      },
      std::runtime_error);
}

TEST_P(UvcCameraTest, ControlsAreTheHostsUntilThePlugIsPulled) {
  const SetupPacket gain{USB_TYPE_CLASS | USB_RECIP_INTERFACE, UVC_SET_CUR,
                         UVC_PU_GAIN_CONTROL << 8, kProcessingUnit << 8 | kControlInterface, 2};
  EXPECT_TRUE(host_->control(gain, Bytes{7, 0}));
  EXPECT_EQ(camera_.state().controls.value(Control::kGain), 7);
  camera_.unplug();
  plugIn();
  EXPECT_EQ(camera_.state().controls.value(Control::kGain), rangeOf(Control::kGain).initial);
  SetupPacket unknown = gain;
  unknown.value = UVC_PU_GAMMA_CONTROL << 8;
  EXPECT_FALSE(host_->control(unknown, Bytes{7, 0})) << "a stall";
  EXPECT_TRUE(host_->control(gain, Bytes{8, 0})) << "and no end";
}

TEST_P(UvcCameraTest, AHostThatIsNoUsbHostIsLeft) {
  int ends[2];
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0);
  const UniqueFd other(ends[1]);
  camera_.connect(UniqueFd(ends[0]));
  const Bytes nonsense(usb_ip::kHeaderBytes, 0xff);
  ASSERT_EQ(send(other.get(), nonsense.data(), nonsense.size(), 0), ssize_t{usb_ip::kHeaderBytes});
  EXPECT_TRUE(
      camera_.waitFor([](const CameraState& s) { return !s.connected; }, milliseconds(5000)));
}

INSTANTIATE_TEST_SUITE_P(Transfers, UvcCameraTest,
                         ::testing::Values(Transfer::kIsochronous, Transfer::kBulk));

}  // namespace
}  // namespace waymark::testing
