// The test camera as the kernel's own drivers see it, before anything of ours: what the tests of
// the frame source and the daemon rest on.
#include <cerrno>
#include <memory>
#include <optional>
#include <vector>

#include <gtest/gtest.h>
#include <linux/videodev2.h>

#include "tests/vm/uvc/uvc_guest.h"
#include "tests/vm/uvc/v4l2_reader.h"
#include "tests/vm/uvc/vhci_port.h"

namespace waymark::testing {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kPatience(30'000);

std::uint32_t v4l2Format(PixelFormat format) {
  switch (format) {
    case PixelFormat::kMjpeg:
      return V4L2_PIX_FMT_MJPEG;
    case PixelFormat::kYuyv:
      return V4L2_PIX_FMT_YUYV;
    case PixelFormat::kGrey:
      return V4L2_PIX_FMT_GREY;
  }
  return 0;
}

V4l2Mode v4l2Mode(const StreamMode& mode) {
  return {v4l2Format(mode.format), mode.width, mode.height,
          static_cast<int>((10'000'000 + mode.interval_100ns / 2) / mode.interval_100ns)};
}

class UvcDriverTest : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_EQ(prepareUvcGuest(), ""); }

  // Plugs the camera in and opens its node. Null, with a failure, when that does not work.
  static std::unique_ptr<V4l2Reader> plugInAndOpen(UvcCamera* camera, int port,
                                                   std::filesystem::path* path = nullptr) {
    const Status plugged = plugIn(camera, port);
    EXPECT_TRUE(plugged) << plugged.error().message;
    const auto node = videoNode(port, kPatience);
    if (!node) {
      ADD_FAILURE() << node.error().message;
      return nullptr;
    }
    if (path != nullptr) *path = *node;
    auto reader = V4l2Reader::open(*node);
    if (!reader) {
      ADD_FAILURE() << reader.error().message;
      return nullptr;
    }
    return std::move(*reader);
  }
};

TEST_F(UvcDriverTest, OffersWhatItsDescriptorsSay) {
  UvcCamera camera(numberedCamera());
  const auto reader = plugInAndOpen(&camera, 0);
  ASSERT_NE(reader, nullptr);
  const std::vector<V4l2Mode> modes = reader->modes();
  std::size_t at = 0;
  for (const Format& format : offeredFormats()) {
    for (const FrameSize& size : format.sizes) {
      for (const std::uint32_t interval : size.intervals_100ns) {
        ASSERT_LT(at, modes.size());
        EXPECT_EQ(modes[at].pixel_format, v4l2Format(format.format));
        EXPECT_EQ(modes[at].width, size.width);
        EXPECT_EQ(modes[at].height, size.height);
        EXPECT_EQ(modes[at].rate_hz, (10'000'000 + interval / 2) / interval);
        ++at;
      }
    }
  }
  EXPECT_EQ(at, modes.size());
}

struct Streaming {
  Transfer transfer;
  PixelFormat format;
  int width;
  int height;
  int rate_hz;
};

class UvcStreaming : public UvcDriverTest, public ::testing::WithParamInterface<Streaming> {};

TEST_P(UvcStreaming, FramesComeByteForByte) {
  const auto [transfer, format, width, height, rate_hz] = GetParam();
  const StreamMode mode = streamMode(format, width, height, rate_hz, transfer);
  UvcCamera camera(numberedCamera(transfer));
  const auto reader = plugInAndOpen(&camera, 0);
  ASSERT_NE(reader, nullptr);
  const Status started = reader->start(v4l2Mode(mode));
  ASSERT_TRUE(started) << started.error().message;

  const int frames = 3 * rate_hz;
  std::int64_t first_ns = 0;
  V4l2Frame frame;
  std::uint64_t next = 0;  // the least that the next frame's index may be
  for (int i = 0; i < frames; ++i) {
    Result<V4l2Frame> read = reader->read(kPatience);
    ASSERT_TRUE(read) << read.error().message;
    frame = std::move(*read);
    if (i == 0) first_ns = frame.monotonic_ns;
    EXPECT_FALSE(frame.error);
    const std::optional<std::uint64_t> index = indexOf(frame.bytes, mode);
    ASSERT_TRUE(index) << "frame " << i << " is not as it was sent";
    // Where this program comes too late with its buffers the driver drops a frame, and counts it:
    // what is missing is missing in the sequence, and nothing else is.
    ASSERT_EQ(*index, frame.sequence);
    ASSERT_GE(*index, next) << "in order";
    next = *index + 1;
  }
  const std::uint64_t missing = next - static_cast<std::uint64_t>(frames);
  EXPECT_LT(missing, static_cast<std::uint64_t>(frames) / 4);
  const double seconds = 1e-9 * static_cast<double>(frame.monotonic_ns - first_ns);
  RecordProperty("rate_hz", std::to_string((frames - 1) / seconds));
  RecordProperty("skipped", std::to_string(camera.state().skipped));
  RecordProperty("missing", std::to_string(missing));
  EXPECT_EQ(camera.state().stream, mode);

  ASSERT_TRUE(reader->stop());
  EXPECT_TRUE(camera.waitFor([](const CameraState& s) { return !s.stream; }, kPatience))
      << "the camera hears of the end";
}

INSTANTIATE_TEST_SUITE_P(
    Modes, UvcStreaming,
    ::testing::Values(Streaming{Transfer::kIsochronous, PixelFormat::kMjpeg, 1280, 720, 30},
                      Streaming{Transfer::kIsochronous, PixelFormat::kYuyv, 640, 480, 30},
                      Streaming{Transfer::kIsochronous, PixelFormat::kGrey, 640, 480, 30},
                      Streaming{Transfer::kBulk, PixelFormat::kMjpeg, 1280, 720, 30},
                      Streaming{Transfer::kBulk, PixelFormat::kYuyv, 640, 480, 30},
                      Streaming{Transfer::kBulk, PixelFormat::kGrey, 640, 480, 30}));

TEST_F(UvcDriverTest, ControlsReachTheCamera) {
  UvcCamera camera(numberedCamera());
  const auto reader = plugInAndOpen(&camera, 0);
  ASSERT_NE(reader, nullptr);
  const auto heard = [&camera](Control control) { return camera.state().controls.value(control); };

  EXPECT_FALSE(reader->setControl(V4L2_CID_EXPOSURE_ABSOLUTE, 80)) << "the exposure is automatic";
  ASSERT_TRUE(reader->setControl(V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL));
  EXPECT_EQ(heard(Control::kExposureMode), kExposureManual);
  ASSERT_TRUE(reader->setControl(V4L2_CID_AUTO_WHITE_BALANCE, 0));
  struct Setting {
    std::uint32_t id;
    Control control;
    std::int32_t value;
  };
  for (const auto& [id, control, value] :
       {Setting{V4L2_CID_EXPOSURE_ABSOLUTE, Control::kExposureTime, 80},
        {V4L2_CID_EXPOSURE_AUTO_PRIORITY, Control::kExposurePriority, 0},
        {V4L2_CID_GAIN, Control::kGain, 33},
        {V4L2_CID_BRIGHTNESS, Control::kBrightness, -10},
        {V4L2_CID_WHITE_BALANCE_TEMPERATURE, Control::kWhiteBalance, 5000},
        {V4L2_CID_POWER_LINE_FREQUENCY, Control::kMainsFrequency, 2}}) {
    EXPECT_NE(heard(control), value) << "a setting that changes nothing proves nothing";
    ASSERT_TRUE(reader->setControl(id, value)) << std::hex << id;
    EXPECT_EQ(heard(control), value);
    const Result<std::int32_t> back = reader->control(id);
    ASSERT_TRUE(back);
    EXPECT_EQ(*back, value);
  }
}

// How many of the next `count` frames came whole; the others are faulty.
struct Tally {
  int whole = 0;
  int marked = 0;    // the driver says that they are faulty
  int unmarked = 0;  // it does not
};

Tally readFrames(V4l2Reader* reader, const StreamMode& mode, int count) {
  Tally tally;
  for (int i = 0; i < count; ++i) {
    const Result<V4l2Frame> frame = reader->read(kPatience);
    if (!frame) {
      ADD_FAILURE() << frame.error().message;
      break;
    }
    if (frame->error) {
      ++tally.marked;
    } else if (indexOf(frame->bytes, mode)) {
      ++tally.whole;
    } else {
      ++tally.unmarked;
    }
  }
  return tally;
}

struct Damage {
  PixelFormat format;
  Fault fault;
  bool known_to_driver;
};

class UvcDamage : public UvcDriverTest, public ::testing::WithParamInterface<Damage> {
 protected:
  // Of 20 frames, of which the camera damages three.
  Tally readDamaged(bool driver_drops) {
    EXPECT_TRUE(setDriverDropsFaultyFrames(driver_drops));
    const StreamMode mode = streamMode(GetParam().format, 640, 480, 30);
    UvcCamera camera(numberedCamera());
    const auto reader = plugInAndOpen(&camera, 0);
    if (reader == nullptr || !reader->start(v4l2Mode(mode))) return {};
    EXPECT_EQ(readFrames(reader.get(), mode, 2).whole, 2);
    camera.damage(GetParam().fault, 3);
    const Tally tally = readFrames(reader.get(), mode, 20);
    EXPECT_EQ(camera.state().damaged, 3U);
    return tally;
  }
};

TEST_P(UvcDamage, TheDriverDropsWhatItKnowsToBeFaulty) {
  const Tally tally = readDamaged(true);
  EXPECT_EQ(tally.marked, 0);
  EXPECT_EQ(tally.unmarked, GetParam().known_to_driver ? 0 : 3);
  EXPECT_EQ(tally.whole, GetParam().known_to_driver ? 20 : 17);
}

TEST_P(UvcDamage, OrMarksItWhereToldTo) {
  const Tally tally = readDamaged(false);
  EXPECT_EQ(tally.marked, GetParam().known_to_driver ? 3 : 0);
  EXPECT_EQ(tally.unmarked, GetParam().known_to_driver ? 0 : 3);
  EXPECT_EQ(tally.whole, 17);
}

INSTANTIATE_TEST_SUITE_P(Kinds, UvcDamage,
                         ::testing::Values(Damage{PixelFormat::kGrey, Fault::kShort, true},
                                           Damage{PixelFormat::kGrey, Fault::kErrorBit, true},
                                           Damage{PixelFormat::kMjpeg, Fault::kErrorBit, true},
                                           Damage{PixelFormat::kMjpeg, Fault::kShort, false},
                                           Damage{PixelFormat::kMjpeg, Fault::kGarbled, false}));

TEST_F(UvcDriverTest, ASilentCameraSendsAgain) {
  const StreamMode mode = streamMode(PixelFormat::kGrey, 640, 480, 30);
  UvcCamera camera(numberedCamera());
  const auto reader = plugInAndOpen(&camera, 0);
  ASSERT_NE(reader, nullptr);
  ASSERT_TRUE(reader->start(v4l2Mode(mode)));
  EXPECT_EQ(readFrames(reader.get(), mode, 5).whole, 5);
  camera.fallSilent(milliseconds(1500));
  Result<V4l2Frame> frame = reader->read(milliseconds(500));
  while (frame.ok()) frame = reader->read(milliseconds(500));  // those on their way
  EXPECT_EQ(reader->errorNumber(), ETIMEDOUT);
  EXPECT_EQ(readFrames(reader.get(), mode, 5).whole, 5);
}

TEST_F(UvcDriverTest, UnplugsWhileStreamingAndComesBackTenTimes) {
  const StreamMode mode = streamMode(PixelFormat::kMjpeg, 1280, 720, 30);
  UvcCamera camera(numberedCamera());
  for (int round = 0; round < 10; ++round) {
    const int port = round % 3;
    const auto reader = plugInAndOpen(&camera, port);
    ASSERT_NE(reader, nullptr) << round;
    ASSERT_TRUE(reader->start(v4l2Mode(mode))) << round;
    EXPECT_EQ(readFrames(reader.get(), mode, 5).whole, 5) << round;
    camera.unplug();
    Result<V4l2Frame> frame = reader->read(kPatience);
    while (frame.ok()) frame = reader->read(kPatience);  // those that the driver had already
    EXPECT_NE(reader->errorNumber(), ETIMEDOUT) << "a reader is told at once";
    EXPECT_TRUE(waitUntilFree(port, kPatience)) << "also while the node is open";
    EXPECT_FALSE(reader->setControl(V4L2_CID_GAIN, 1));
    EXPECT_EQ(reader->errorNumber(), ENODEV);
  }
}

TEST_F(UvcDriverTest, IdenticalCamerasAreToldApartByTheirPorts) {
  const StreamMode mode = streamMode(PixelFormat::kGrey, 320, 240, 30);
  std::vector<std::unique_ptr<UvcCamera>> cameras;
  std::string bus_info[2];
  for (int i = 0; i < 2; ++i) {
    cameras.push_back(std::make_unique<UvcCamera>(numberedCamera(Transfer::kIsochronous, i)));
  }
  std::filesystem::path paths[2][2];
  for (const bool reversed : {false, true}) {
    std::vector<std::unique_ptr<V4l2Reader>> readers(2);
    for (const int i : reversed ? std::vector{1, 0} : std::vector{0, 1}) {
      const auto index = static_cast<std::size_t>(i);
      readers[index] = plugInAndOpen(cameras[index].get(), i, &paths[reversed ? 1 : 0][i]);
      ASSERT_NE(readers[index], nullptr);
      if (!reversed) bus_info[i] = readers[index]->busInfo();
      EXPECT_EQ(readers[index]->busInfo(), bus_info[i]) << "the port's, in any order";
      ASSERT_TRUE(readers[index]->start(v4l2Mode(mode)));
    }
    // Both at the same time.
    for (int frame = 0; frame < 10; ++frame) {
      for (int i = 0; i < 2; ++i) {
        const Result<V4l2Frame> read = readers[static_cast<std::size_t>(i)]->read(kPatience);
        ASSERT_TRUE(read) << read.error().message;
        EXPECT_TRUE(indexOf(read->bytes, mode, i)) << "its own frames";
      }
    }
    for (const auto& camera : cameras) camera->unplug();
    for (int i = 0; i < 2; ++i) ASSERT_TRUE(waitUntilFree(i, kPatience));
  }
  EXPECT_NE(bus_info[0], bus_info[1]);
  EXPECT_NE(paths[0][0], paths[0][1]);
  EXPECT_NE(paths[0][0], paths[1][0]) << "the number of the node is an accident";
}

}  // namespace
}  // namespace waymark::testing
