// libcamera's cameras with the kernel's uvcvideo driver below it and a camera that can be
// unplugged.
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include <gtest/gtest.h>

#include "base/clock.h"
#include "capture/libcamera/libcamera_source.h"
#include "tests/process.h"
#include "tests/vm/uvc/film_frames.h"
#include "tests/vm/uvc/uvc_guest.h"

namespace waymark::testing {
namespace {

using capture::FramePtr;
using capture::FrameSource;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kPatience(60'000);

class UvcLibcameraTest : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(prepareUvcGuest(), "");
    // Its camera, if another test loaded it, would be number 0.
    const ProgramResult alone = runProgram({"modprobe", "-r", "vimc"});
    ASSERT_EQ(alone.exit_code, 0) << alone.err;
    // libcamera passes over USB cameras on a bus without an ACPI node.
    const ProgramResult linked = runProgram({"modprobe", "waymark_acpi_link"});
    ASSERT_EQ(linked.exit_code, 0) << linked.err;
  }

  // Once libcamera has noticed that it was plugged in.
  static std::unique_ptr<FrameSource> openInTime(const capture::Opener& opener) {
    const auto until = steady_clock::now() + kPatience;
    while (true) {
      auto source = opener();
      if (source) return std::move(*source);
      if (steady_clock::now() > until) {
        ADD_FAILURE() << source.error().message;
        return nullptr;
      }
      std::this_thread::sleep_for(milliseconds(100));
    }
  }
  static std::unique_ptr<FrameSource> open(const capture::SourceOptions& options) {
    const Result<capture::Opener> opener = capture::sourceOpener("libcamera:0", options);
    EXPECT_TRUE(opener) << opener.error().message;
    return opener ? openInTime(*opener) : nullptr;
  }
};

struct LibcameraFormat {
  const char* name;
  PixelFormat format;
  int tolerance;  // grey levels
};

class UvcLibcameraFormat : public UvcLibcameraTest,
                           public ::testing::WithParamInterface<LibcameraFormat> {};

TEST_P(UvcLibcameraFormat, FramesAreThePicturesThatTheCameraSent) {
  const StreamMode mode = streamMode(GetParam().format, 640, 480, static_cast<int>(kFilmRate_hz));
  const FilmPictures pictures(mode);
  UvcCamera camera(film().camera());
  ASSERT_NE(plugInAt(&camera, 0), "");
  const auto source = open(filmOptions(GetParam().name));
  ASSERT_NE(source, nullptr);
  std::int64_t before_ns = 0;
  for (int i = 0; i < 20; ++i) {
    const FramePtr frame = readFrame(source.get());
    ASSERT_NE(frame, nullptr);
    EXPECT_LE(pictures.find(frame->image()).worst, GetParam().tolerance);
    EXPECT_GT(frame->stamp().monotonic_ns, before_ns);
    EXPECT_LE(frame->stamp().monotonic_ns, monotonicNs());
    before_ns = frame->stamp().monotonic_ns;
  }
  EXPECT_EQ(camera.state().stream->format, GetParam().format);
  EXPECT_EQ(source->counters().dropped_corrupt, 0U);
  EXPECT_EQ(source->counters().stamped_on_arrival, 0U);
}

INSTANTIATE_TEST_SUITE_P(Formats, UvcLibcameraFormat,
                         ::testing::Values(LibcameraFormat{"GREY", PixelFormat::kGrey, 0},
                                           LibcameraFormat{"YUYV", PixelFormat::kYuyv, 0},
                                           LibcameraFormat{"MJPG", PixelFormat::kMjpeg, 2}));

TEST_F(UvcLibcameraTest, ExposureReachesTheCamera) {
  UvcCamera camera(film().camera());
  ASSERT_NE(plugInAt(&camera, 0), "");
  capture::SourceOptions options = filmOptions("YUYV");
  options.camera.exposure_s = 0.008;
  options.camera.controls["Brightness"] = 0.5;
  const auto source = open(options);
  ASSERT_NE(source, nullptr);
  ASSERT_NE(readFrame(source.get()), nullptr);
  std::string warnings;
  for (const std::string& warning : source->info().warnings) warnings += warning + "\n";
  SCOPED_TRACE(warnings);
  EXPECT_EQ(camera.state().controls.value(Control::kExposureMode), kExposureManual);
  EXPECT_EQ(camera.state().controls.value(Control::kExposureTime), 80);
  EXPECT_GT(camera.state().controls.value(Control::kBrightness), 0);
}

TEST_F(UvcLibcameraTest, DamagedFramesAreNotHandedOut) {
  const StreamMode mode = streamMode(PixelFormat::kMjpeg, 640, 480, static_cast<int>(kFilmRate_hz));
  const FilmPictures pictures(mode);
  UvcCamera camera(film().camera());
  ASSERT_NE(plugInAt(&camera, 0), "");
  const auto source = open(filmOptions("MJPG"));
  ASSERT_NE(source, nullptr);
  ASSERT_NE(readFrame(source.get()), nullptr);
  constexpr std::uint64_t kFaulty = 4;
  camera.damage(Fault::kShort, kFaulty);
  for (int after = 0; after < 5;) {
    const FramePtr frame = readFrame(source.get());
    ASSERT_NE(frame, nullptr);
    EXPECT_LE(pictures.find(frame->image()).worst, 2) << "as good as any";
    if (camera.state().damaged == kFaulty) ++after;
  }
  const capture::SourceCounters counters = source->counters();
  EXPECT_GE(counters.dropped_corrupt, 1U);
  EXPECT_GE(counters.dropped_corrupt + counters.dropped_late, kFaulty);
}

TEST_F(UvcLibcameraTest, AnUnpluggedCameraFallsSilentAndOpensAgain) {
  UvcCamera camera(film().camera());
  ASSERT_NE(plugInAt(&camera, 0), "");
  const Result<capture::Opener> opener = capture::sourceOpener("libcamera:0", filmOptions("MJPG"));
  ASSERT_TRUE(opener) << opener.error().message;
  for (int round = 0; round < 3; ++round) {
    std::unique_ptr<FrameSource> source = openInTime(*opener);
    ASSERT_NE(source, nullptr) << round;
    ASSERT_NE(readFrame(source.get()), nullptr) << round;
    camera.unplug();
    // Frames on their way still come; then there are none, and no error either.
    bool silent = false;
    for (int i = 0; i < 20 && !silent; ++i) {
      const capture::ReadResult read = source->read(milliseconds(500));
      silent = !std::holds_alternative<FramePtr>(read);
    }
    EXPECT_TRUE(silent);
    source.reset();
    ASSERT_NE(plugInAt(&camera, 0), "");
  }
}

}  // namespace
}  // namespace waymark::testing
