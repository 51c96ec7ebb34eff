// waymarkd with a USB camera that fails in every way a camera can: what is tested is that the
// daemon does not, and that it finds its way back.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "base/clock.h"
#include "io/calibrations/calibration_file.h"
#include "tests/multicast.h"
#include "tests/process.h"
#include "tests/subscriber.h"
#include "tests/temporary_directory.h"
#include "tests/vm/uvc/film_frames.h"
#include "tests/vm/uvc/uvc_guest.h"
#include "tests/vm/uvc/vhci_port.h"

namespace waymark::testing {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kPatience(300'000);  // an emulated machine is slow
constexpr double kTolerance_m = 0.02;       // of a place in the map, emulated film included
Eigen::Vector3d positionOf(const pose_t& pose) { return Eigen::Vector3d(pose.p_w_c); }

bool hasPose(const pose_t& pose) { return pose.source == pose_t::SOURCE_MARKERS; }

// A waymarkd with its camera, and everything that it publishes.
class UvcDaemonTest : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(prepareUvcGuest(), "");
    ASSERT_TRUE(ensureMulticastRoute());
  }

  void startDaemon(const std::string& source, const std::string& format) {
    const std::string url = randomUrl();
    ASSERT_TRUE(io::writeCalibration(directory_ / "calib.yml", film().calibration()));
    std::ofstream(directory_ / "waymarkd.toml")
        << "[camera]\nsource = '" << source << "'\ncalibration = 'calib.yml'\nrate_hz = 5\n"
        << "format = '" << format << "'\nexposure_s = 0.008\n"
        << "[camera.controls]\ngain = 33\n"
        << "[slam]\ndictionary = 'ARUCO_MIP_36h12'\nmarker_size_m = 0.165\n"
        << "[publish]\nchannel_prefix = 'TEST_'\nurl = '" << url << "'\n";
    subscriber_ = std::make_unique<Subscriber>(url, "TEST_");
    daemon_ = std::make_unique<Process>(
        std::vector<std::string>{WAYMARKD, "--config", (directory_ / "waymarkd.toml").string()},
        directory_ / "daemon.err");
  }

  // A clean end, with every frame accounted for.
  void stopDaemon() {
    daemon_->signal(SIGTERM);
    EXPECT_EQ(daemon_->wait(kPatience), 0) << account();
    const auto complete = [](const Received& r) {
      return r.counters()["published.poses"] == static_cast<std::int64_t>(r.framePoses().size());
    };
    EXPECT_TRUE(subscriber_->waitFor(complete, milliseconds(10'000)));
    std::int64_t of_source = 0;
    std::int64_t dropped = 0;
    for (const auto& [name, value] : subscriber_->received().counters()) {
      if (name == "camera.frames" || name.starts_with("dropped.source_")) of_source += value;
      if (name == "published.poses" || name.starts_with("dropped.")) dropped += value;
    }
    EXPECT_EQ(of_source, dropped) << account();
  }

  // Waits for as many frames with poses that were taken after that time.
  [[nodiscard]] bool waitForPoses(std::size_t count, std::int64_t since_ns = 0) const {
    return subscriber_->waitFor(
        [count, since_ns](const Received& r) {
          return count <= static_cast<std::size_t>(
                              std::ranges::count_if(r.poses, [since_ns](const pose_t& pose) {
                                return hasPose(pose) && pose.monotonic_ns > since_ns;
                              }));
        },
        kPatience);
  }
  [[nodiscard]] bool waitForCamera(std::int8_t state, std::int64_t since_ns) const {
    return subscriber_->waitFor(
        [state, since_ns](const Received& r) {
          return !r.healths.empty() && r.healths.back().camera == state &&
                 r.healths.back().monotonic_ns > since_ns;
        },
        kPatience);
  }
  [[nodiscard]] std::int64_t counter(const std::string& name) const {
    return subscriber_->received().counters()[name];
  }
  [[nodiscard]] bool waitForCounter(const std::string& name, std::int64_t value) const {
    return subscriber_->waitFor([&](const Received& r) { return r.counters()[name] >= value; },
                                kPatience);
  }

  // The map is made, and the whole film has been seen.
  void waitForMap() {
    ASSERT_TRUE(waitForPoses(2 * static_cast<std::size_t>(film().period()))) << account();
    known_ = subscriber_->received().framePoses();
    double farthest_m = 0.0;
    for (const pose_t& pose : known_) {
      if (!hasPose(pose)) continue;
      farthest_m = std::max(farthest_m, (positionOf(pose) - positionOf(known_.back())).norm());
    }
    ASSERT_GT(farthest_m, 10 * kTolerance_m) << "a camera at rest proves little";
  }

  // How far a pose is from the nearest that was known then: the film shows the same way again.
  [[nodiscard]] double distanceToWay_m(const pose_t& pose) const {
    double min_m = std::numeric_limits<double>::infinity();
    for (const pose_t& known : known_) {
      if (!hasPose(known)) continue;
      min_m = std::min(min_m, (positionOf(known) - positionOf(pose)).norm());
    }
    return min_m;
  }
  // The greatest of all that came since; 0 when none did.
  [[nodiscard]] double farthestFromWay_m() const {
    double greatest_m = 0.0;
    for (const pose_t& pose : subscriber_->received().framePoses()) {
      if (hasPose(pose)) greatest_m = std::max(greatest_m, distanceToWay_m(pose));
    }
    return greatest_m;
  }

  // What the daemon said and counted, for messages.
  [[nodiscard]] std::string account() const {
    std::string text = daemon_->stderrText();
    for (const auto& [name, value] : subscriber_->received().counters()) {
      if (value != 0) text += name + " = " + std::to_string(value) + "\n";
    }
    return text;
  }

  void expectCounted(UvcCamera* camera, Fault fault, int frames, const std::string& name);

  // The first frame that was taken after that time.
  [[nodiscard]] pose_t firstFrameSince(std::int64_t since_ns) const {
    for (const pose_t& pose : subscriber_->received().framePoses()) {
      if (pose.monotonic_ns > since_ns) return pose;
    }
    return {};
  }

  TemporaryDirectory directory_;
  std::unique_ptr<Subscriber> subscriber_;
  std::unique_ptr<Process> daemon_;
  std::vector<pose_t> known_;
};

// Has the camera damage some frames. Each is counted under that name, or was dropped unseen, with
// others, because the machine was too slow.
void UvcDaemonTest::expectCounted(UvcCamera* camera, Fault fault, int frames,
                                  const std::string& name) {
  const std::int64_t before = counter(name);
  const std::int64_t late_before = counter("dropped.source_late");
  const std::uint64_t damaged_before = camera->state().damaged;
  camera->damage(fault, frames);
  ASSERT_TRUE(camera->waitFor(
      [&](const CameraState& s) {
        return s.damaged == damaged_before + static_cast<std::uint64_t>(frames);
      },
      kPatience));
  ASSERT_TRUE(waitForPoses(10, monotonicNs())) << account();
  EXPECT_GE(counter(name), before + 1) << account();
  EXPECT_LE(counter(name), before + frames);
  EXPECT_GE(counter(name) + counter("dropped.source_late"), before + late_before + frames);
}

TEST_F(UvcDaemonTest, SurvivesTenUnpluggings) {
  UvcCamera camera(film().camera());
  ASSERT_NE(plugInAt(&camera, 0), "");
  startDaemon("v4l2:serial=0001", "MJPG");
  ASSERT_NO_FATAL_FAILURE(waitForMap());
  const std::size_t descriptors = openDescriptors(daemon_->pid());
  const std::size_t markers = subscriber_->received().maps.back().marker_count;
  double slowest_s = 0.0;

  for (int round = 1; round <= 10; ++round) {
    const std::int64_t unplugged_ns = monotonicNs();
    camera.unplug();
    ASSERT_TRUE(waitForCamera(health_t::CAMERA_LOST, unplugged_ns)) << round;
    // Now and then elsewhere: its serial number says who it is.
    const int port = round % 4 == 0 ? 1 : 0;
    ASSERT_NE(plugInAt(&camera, port), "");
    // From here on it is the daemon's time: before its rules have run, udev tells nobody.
    ASSERT_TRUE(waitForPath(videoLink(port), kPatience));
    const std::int64_t there_ns = monotonicNs();
    ASSERT_TRUE(waitForPoses(5, unplugged_ns)) << round << "\n" << account();

    const pose_t first = firstFrameSince(unplugged_ns);
    EXPECT_TRUE(hasPose(first)) << round
                                << ": the first good frame has its place: " << first.reason;
    EXPECT_LT(distanceToWay_m(first), kTolerance_m) << round << ": in the same map";
    slowest_s = std::max(slowest_s, 1e-9 * static_cast<double>(first.monotonic_ns - there_ns));
    EXPECT_EQ(openDescriptors(daemon_->pid()), descriptors) << round;
    EXPECT_EQ(camera.state().controls.value(Control::kGain), 33) << "set again";
    EXPECT_EQ(camera.state().controls.value(Control::kExposureTime), 80);
    EXPECT_FALSE(daemon_->wait(milliseconds(0))) << "the same process";
  }
  RecordProperty("slowest_reopening_s", std::to_string(slowest_s));
  EXPECT_LT(slowest_s, 2.0);
  EXPECT_TRUE(waitForCounter("camera.reopened", 10));
  EXPECT_GE(static_cast<std::size_t>(subscriber_->received().maps.back().marker_count), markers);
  stopDaemon();
}

TEST_F(UvcDaemonTest, FaultyFramesAreCountedByCauseAndPlaceNothing) {
  ASSERT_TRUE(setDriverDropsFaultyFrames(false));
  UvcCamera camera(film().camera());
  ASSERT_NE(plugInAt(&camera, 0), "");
  startDaemon("v4l2:serial=0001", "MJPG");
  ASSERT_NO_FATAL_FAILURE(waitForMap());
  EXPECT_EQ(counter("dropped.source_corrupt"), 0);
  EXPECT_EQ(counter("dropped.source_flagged"), 0);

  expectCounted(&camera, Fault::kShort, 3, "dropped.source_corrupt");
  expectCounted(&camera, Fault::kGarbled, 4, "dropped.source_corrupt");
  expectCounted(&camera, Fault::kErrorBit, 5, "dropped.source_flagged");
  EXPECT_EQ(counter("camera.reopened"), 0) << "no reason to";
  EXPECT_LT(farthestFromWay_m(), kTolerance_m);
  stopDaemon();
}

TEST_F(UvcDaemonTest, ASilentCameraIsOpenedAgain) {
  UvcCamera camera(film().camera());
  ASSERT_NE(plugInAt(&camera, 0), "");
  startDaemon("v4l2:serial=0001", "GREY");
  ASSERT_NO_FATAL_FAILURE(waitForMap());
  const std::int64_t silent_ns = monotonicNs();
  camera.fallSilent(milliseconds(6000));
  EXPECT_TRUE(waitForCamera(health_t::CAMERA_LOST, silent_ns));
  ASSERT_TRUE(waitForPoses(10, silent_ns + 3'000'000'000)) << account();
  EXPECT_TRUE(waitForCounter("camera.silences", 1));
  EXPECT_TRUE(waitForCounter("camera.reopened", 1));
  EXPECT_LT(distanceToWay_m(firstFrameSince(silent_ns + 3'000'000'000)), kTolerance_m);
  stopDaemon();
}

TEST_F(UvcDaemonTest, OfTwoAlikeTheConfiguredOneIsOpenedAlsoInTheOtherOrder) {
  UvcCamera other(numberedCamera());
  UvcCamera camera(film().camera());
  ASSERT_NE(plugInAt(&other, 0), "");
  ASSERT_NE(plugInAt(&camera, 1), "");
  startDaemon("v4l2:" + videoLink(1).string(), "GREY");
  ASSERT_NO_FATAL_FAILURE(waitForMap());
  for (const bool reversed : {true, false}) {
    const std::int64_t unplugged_ns = monotonicNs();
    camera.unplug();
    other.unplug();
    ASSERT_TRUE(waitForCamera(health_t::CAMERA_LOST, unplugged_ns));
    for (int port = 0; port < 2; ++port) ASSERT_TRUE(waitUntilFree(port, kPatience));
    ASSERT_NE(reversed ? plugInAt(&camera, 1) : plugInAt(&other, 0), "");
    // The other one, alone, looks the same: for long enough to be taken for it.
    std::this_thread::sleep_for(milliseconds(reversed ? 0 : 3000));
    ASSERT_NE(reversed ? plugInAt(&other, 0) : plugInAt(&camera, 1), "");
    ASSERT_TRUE(waitForPoses(10, unplugged_ns + 1'000'000'000)) << account();
    EXPECT_LT(distanceToWay_m(subscriber_->received().framePoses().back()), kTolerance_m);
  }
  EXPECT_EQ(other.state().asked, 0U) << "nobody ever wanted a frame of the other one";
  stopDaemon();
}

}  // namespace
}  // namespace waymark::testing
