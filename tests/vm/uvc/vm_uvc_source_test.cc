// The frame source of V4L2 cameras with the kernel's uvcvideo driver and a camera that can be told
// to fail.
#include <algorithm>
#include <chrono>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include <gtest/gtest.h>

#include "base/clock.h"
#include "capture/open_source.h"
#include "tests/vm/uvc/film_frames.h"
#include "tests/vm/uvc/scene_film.h"
#include "tests/vm/uvc/uvc_guest.h"
#include "tests/vm/uvc/vhci_port.h"

namespace waymark::testing {
namespace {

using capture::FramePtr;
using capture::FrameSource;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kPatience(30'000);

class UvcSourceTest : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_EQ(prepareUvcGuest(), ""); }
};

struct FormatCase {
  const char* name;
  PixelFormat format;
  int tolerance;  // grey levels
};

class UvcFormat : public UvcSourceTest, public ::testing::WithParamInterface<FormatCase> {};

TEST_P(UvcFormat, FramesAreThePicturesThatTheCameraSent) {
  const StreamMode mode = streamMode(GetParam().format, 640, 480, static_cast<int>(kFilmRate_hz));
  const FilmPictures pictures(mode);
  UvcCamera camera(film().camera());
  const std::string node = plugInAt(&camera, 0);
  const auto source = openForTest("v4l2:" + node, filmOptions(GetParam().name));
  ASSERT_NE(source, nullptr);
  EXPECT_EQ(source->info().width, 640);
  EXPECT_EQ(source->info().height, 480);
  EXPECT_NEAR(source->info().rate_hz, kFilmRate_hz, 0.01);
  EXPECT_TRUE(source->info().live);
  EXPECT_EQ(source->info().warnings, std::vector<std::string>{});

  std::int64_t before_ns = 0;
  for (int i = 0; i < 35; ++i) {
    const FramePtr frame = readFrame(source.get());
    ASSERT_NE(frame, nullptr);
    EXPECT_EQ(camera.state().stream, mode);
    const FilmPictures::Match shown = pictures.find(frame->image());
    // The camera's count and ours are the same: it counts no frame that it was not asked for.
    EXPECT_EQ(shown.picture, film().pictureOf(frame->stamp().sequence));
    EXPECT_LE(shown.worst, GetParam().tolerance);

    const std::int64_t now_ns = monotonicNs();
    EXPECT_GT(frame->stamp().monotonic_ns, before_ns);
    EXPECT_LE(frame->stamp().monotonic_ns, now_ns);
    EXPECT_GT(frame->stamp().monotonic_ns, now_ns - 2'000'000'000);
    // The wall clock, read between two readings of the other one: the guest may be held up there.
    const std::int64_t early_ns = monotonicNs();
    const std::int64_t wall_ns = 1000 * wallUs();
    const std::int64_t late_ns = monotonicNs();
    const std::int64_t utime_ns = 1000 * frame->stamp().utime;
    EXPECT_GT(utime_ns, wall_ns + frame->stamp().monotonic_ns - late_ns - 5'000'000);
    EXPECT_LT(utime_ns, wall_ns + frame->stamp().monotonic_ns - early_ns + 5'000'000);
    before_ns = frame->stamp().monotonic_ns;
  }
  const capture::SourceCounters counters = source->counters();
  EXPECT_EQ(counters.frames, 35U);
  EXPECT_EQ(counters.dropped_corrupt, 0U);
  EXPECT_EQ(counters.dropped_flagged, 0U);
  EXPECT_EQ(counters.stamped_on_arrival, 0U);
}

INSTANTIATE_TEST_SUITE_P(Formats, UvcFormat,
                         ::testing::Values(FormatCase{"GREY", PixelFormat::kGrey, 0},
                                           FormatCase{"YUYV", PixelFormat::kYuyv, 0},
                                           FormatCase{"MJPG", PixelFormat::kMjpeg, 2}));

TEST_F(UvcSourceTest, ExposureAndGainAreSetAndReadBack) {
  UvcCamera camera(film().camera());
  const std::string node = plugInAt(&camera, 0);
  capture::SourceOptions options = filmOptions("GREY");
  options.camera.exposure_s = 0.008;
  options.camera.controls["gain"] = std::int64_t{33};
  options.camera.controls["brightness"] = std::int64_t{-10};
  options.camera.controls["power_line_frequency"] = std::string("60 Hz");
  const auto source = openForTest("v4l2:" + node, options);
  ASSERT_NE(source, nullptr);
  EXPECT_EQ(source->info().warnings, std::vector<std::string>{});
  const UvcControls heard = camera.state().controls;
  EXPECT_EQ(heard.value(Control::kExposureMode), kExposureManual);
  EXPECT_EQ(heard.value(Control::kExposureTime), 80);
  EXPECT_EQ(heard.value(Control::kGain), 33);
  EXPECT_EQ(heard.value(Control::kBrightness), -10);
  EXPECT_EQ(heard.value(Control::kMainsFrequency), 2);
  const FramePtr frame = readFrame(source.get());
  ASSERT_NE(frame, nullptr);
  EXPECT_EQ(frame->stamp().exposure_ns, 8'000'000) << "read back from the camera";
}

TEST_F(UvcSourceTest, WhatTheCameraCannotDoIsAWarning) {
  UvcCamera camera(film().camera());
  const std::string node = plugInAt(&camera, 0);
  capture::SourceOptions options = filmOptions("GREY");
  options.camera.controls["gain"] = std::int64_t{1000};
  options.camera.controls["gamma"] = std::int64_t{100};
  const auto source = openForTest("v4l2:" + node, options);
  ASSERT_NE(source, nullptr);
  const std::vector<std::string>& warnings = source->info().warnings;
  ASSERT_EQ(warnings.size(), 2U);
  const auto says = [&warnings](const std::string& text) {
    return std::ranges::count_if(warnings, [&text](const std::string& warning) {
      return warning.find(text) != std::string::npos;
    });
  };
  EXPECT_EQ(says("gain: must be"), 1) << warnings[0] << "\n" << warnings[1];
  EXPECT_EQ(says("gamma: the camera has no such control"), 1) << warnings[0] << "\n" << warnings[1];
  EXPECT_NE(readFrame(source.get()), nullptr) << "frames come all the same";

  EXPECT_FALSE(capture::openSource("v4l2:" + node, filmOptions("NV12")));
}

struct DamageCase {
  const char* name;
  PixelFormat format;
  Fault fault;
  bool driver_drops;
  std::uint64_t capture::SourceCounters::*counter;
};

class UvcDamagedSource : public UvcSourceTest, public ::testing::WithParamInterface<DamageCase> {};

TEST_P(UvcDamagedSource, FaultyFramesAreCountedAndNeverHandedOut) {
  ASSERT_TRUE(setDriverDropsFaultyFrames(GetParam().driver_drops));
  const StreamMode mode = streamMode(GetParam().format, 640, 480, static_cast<int>(kFilmRate_hz));
  const FilmPictures pictures(mode);
  UvcCamera camera(film().camera());
  const std::string node = plugInAt(&camera, 0);
  const auto source = openForTest("v4l2:" + node, filmOptions(GetParam().name));
  ASSERT_NE(source, nullptr);
  ASSERT_NE(readFrame(source.get()), nullptr);

  constexpr std::uint64_t kFaulty = 4;
  camera.damage(GetParam().fault, kFaulty);
  std::uint64_t sequence = 0;
  // Until frames come that were sent after the damaged ones.
  for (int after = 0; after < 5;) {
    const FramePtr frame = readFrame(source.get());
    ASSERT_NE(frame, nullptr);
    const FilmPictures::Match shown = pictures.find(frame->image());
    EXPECT_LE(shown.worst, 2) << "as good as any";
    EXPECT_EQ(shown.picture, film().pictureOf(frame->stamp().sequence));
    sequence = frame->stamp().sequence;
    if (camera.state().damaged == kFaulty) ++after;
  }
  const capture::SourceCounters counters = source->counters();
  std::uint64_t all = 0;
  for (const auto& named : capture::kSourceCounters) all += counters.*named.value;
  EXPECT_EQ(all, sequence + 1) << "every frame is in one of the counters";
  // Where the test itself is late, some are that before anybody looks at them.
  EXPECT_GE(counters.*GetParam().counter, 1U);
  EXPECT_LE(counters.*GetParam().counter, kFaulty);
  EXPECT_GE(counters.*GetParam().counter + counters.dropped_late, kFaulty);
  for (const auto& named : capture::kSourceCounters) {
    if (named.value == GetParam().counter || named.value == &capture::SourceCounters::frames ||
        named.value == &capture::SourceCounters::dropped_late) {
      continue;
    }
    EXPECT_EQ(counters.*named.value, 0U) << named.name;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Faults, UvcDamagedSource,
    ::testing::Values(DamageCase{"MJPG", PixelFormat::kMjpeg, Fault::kShort, true,
                                 &capture::SourceCounters::dropped_corrupt},
                      DamageCase{"MJPG", PixelFormat::kMjpeg, Fault::kGarbled, true,
                                 &capture::SourceCounters::dropped_corrupt},
                      DamageCase{"MJPG", PixelFormat::kMjpeg, Fault::kErrorBit, true,
                                 &capture::SourceCounters::dropped_gap},
                      DamageCase{"MJPG", PixelFormat::kMjpeg, Fault::kErrorBit, false,
                                 &capture::SourceCounters::dropped_flagged},
                      DamageCase{"GREY", PixelFormat::kGrey, Fault::kShort, true,
                                 &capture::SourceCounters::dropped_gap},
                      DamageCase{"GREY", PixelFormat::kGrey, Fault::kShort, false,
                                 &capture::SourceCounters::dropped_flagged},
                      DamageCase{"YUYV", PixelFormat::kYuyv, Fault::kShort, false,
                                 &capture::SourceCounters::dropped_flagged}));

TEST_F(UvcSourceTest, WhatALateReaderMissesIsNotTheCablesFault) {
  UvcCamera camera(film().camera());
  const std::string node = plugInAt(&camera, 0);
  const auto source = openForTest("v4l2:" + node, filmOptions("MJPG"));
  ASSERT_NE(source, nullptr);
  ASSERT_NE(readFrame(source.get()), nullptr);
  const std::uint64_t sent = camera.state().sent;
  ASSERT_TRUE(
      camera.waitFor([sent](const CameraState& s) { return s.sent >= sent + 10; }, kPatience));
  FramePtr frame;
  for (int i = 0; i < 3; ++i) frame = readFrame(source.get());
  ASSERT_NE(frame, nullptr);
  const capture::SourceCounters counters = source->counters();
  EXPECT_GE(counters.dropped_late, 1U) << "old ones waited";
  EXPECT_GE(counters.dropped_no_buffer, 1U) << "for others there was no room";
  EXPECT_EQ(counters.dropped_gap, 0U);
  EXPECT_EQ(counters.frames + counters.dropped_late + counters.dropped_no_buffer,
            frame->stamp().sequence + 1);
}

TEST_F(UvcSourceTest, ASilentCameraIsNoFailureYet) {
  UvcCamera camera(film().camera());
  const std::string node = plugInAt(&camera, 0);
  const auto source = openForTest("v4l2:" + node, filmOptions("GREY"));
  ASSERT_NE(source, nullptr);
  ASSERT_NE(readFrame(source.get()), nullptr);
  camera.fallSilent(milliseconds(2000));
  bool timed_out = false;
  for (int i = 0; i < 10 && !timed_out; ++i) {
    const auto begin = steady_clock::now();
    const capture::ReadResult read = source->read(milliseconds(300));
    timed_out = std::holds_alternative<capture::TimedOut>(read);
    EXPECT_FALSE(std::holds_alternative<Error>(read));
    if (timed_out) {
      EXPECT_GE(steady_clock::now() - begin, milliseconds(299));
      EXPECT_LT(steady_clock::now() - begin, milliseconds(1000)) << "it returns in time";
    }
  }
  EXPECT_TRUE(timed_out);
  EXPECT_NE(readFrame(source.get()), nullptr);
}

// Reads until the source fails; false when it does not.
bool failsInTime(FrameSource* source) {
  const auto until = steady_clock::now() + kPatience;
  while (steady_clock::now() < until) {
    if (std::holds_alternative<Error>(source->read(milliseconds(100)))) return true;
  }
  return false;
}

TEST_F(UvcSourceTest, AnUnpluggedCameraIsAnErrorAndOpensAgain) {
  UvcCamera camera(film().camera());
  std::string node = plugInAt(&camera, 0);
  const Result<capture::Opener> opener = capture::sourceOpener("v4l2:" + node, filmOptions("MJPG"));
  ASSERT_TRUE(opener) << opener.error().message;
  for (int round = 0; round < 3; ++round) {
    auto opened = (*opener)();
    ASSERT_TRUE(opened) << opened.error().message;
    const std::unique_ptr<FrameSource> source = std::move(*opened);
    ASSERT_NE(readFrame(source.get()), nullptr);
    camera.unplug();
    EXPECT_TRUE(failsInTime(source.get()));
    EXPECT_FALSE((*opener)()) << "it is not there";
    // Somewhere else, and under another name: its serial number says who it is.
    const std::string again = plugInAt(&camera, (round + 1) % 3);
    EXPECT_NE(again, node) << "the old name is still taken";
    node = again;
  }
}

// What a name must lead to, with two cameras that differ in nothing but where they are.
struct NameCase {
  const char* what;
  std::string spec;  // of the one at port 1
};

TEST_F(UvcSourceTest, OfTwoAlikeTheOneThatIsNamedIsOpened) {
  UvcCamera first(film().camera());
  UvcCamera second(film().camera());
  UvcCamera* const cameras[] = {&first, &second};
  const NameCase names[] = {{"bus", "v4l2:bus=usb-vhci_hcd.0-2"},
                            {"link", "v4l2:" + videoLink(1).string()}};
  std::vector<capture::Opener> openers;
  for (const NameCase& name : names) {
    const Result<capture::Opener> opener = capture::sourceOpener(name.spec, filmOptions("GREY"));
    ASSERT_TRUE(opener) << opener.error().message;
    openers.push_back(*opener);
  }
  for (const bool reversed : {false, true, false}) {
    for (const int i : reversed ? std::vector{1, 0} : std::vector{0, 1}) {
      ASSERT_FALSE(plugInAt(cameras[i], i).empty());
      ASSERT_TRUE(waitForPath(videoLink(i), kPatience));
    }
    for (std::size_t i = 0; i < openers.size(); ++i) {
      const auto opened = openers[i]();
      ASSERT_TRUE(opened) << names[i].what << ": " << opened.error().message;
      EXPECT_NE(readFrame(opened.value().get()), nullptr);
      EXPECT_TRUE(second.state().stream) << names[i].what;
      EXPECT_FALSE(first.state().stream) << names[i].what;
    }
    EXPECT_TRUE(second.waitFor([](const CameraState& s) { return !s.stream; }, kPatience));
    EXPECT_FALSE(capture::openSource("v4l2:serial=0001", filmOptions("GREY"))) << "it is either's";
    first.unplug();
    second.unplug();
    for (int port = 0; port < 2; ++port) ASSERT_TRUE(waitUntilFree(port, kPatience));
  }
}

}  // namespace
}  // namespace waymark::testing
