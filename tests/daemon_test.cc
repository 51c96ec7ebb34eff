// waymarkd as its users meet it: a process of its own, with LCM subscribers in another.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <sched.h>

#include "base/unique_fd.h"
#include "tests/multicast.h"
#include "tests/process.h"
#include "tests/subscriber.h"
#include "tests/temporary_directory.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

constexpr const char* kCalibration = R"(%YAML:1.0
---
image_width: 64
image_height: 48
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 60., 0., 31.5, 0., 60., 23.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0., 0., 0., 0., 0. ]
)";

const std::string kSlam = "[slam]\ndictionary = \"4X4_50\"\nmarker_size_m = 0.1\n";

class DaemonTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!ensureMulticastRoute()) GTEST_SKIP() << "no multicast route, and none may be made";
    write("calib.yml", kCalibration);
  }

  // A recording without a marker: what is tested here is the way of frames, not what is in them.
  void writeImages(int count) const {
    fs::create_directory(directory_ / "images");
    for (int i = 0; i < count; ++i) {
      char name[32];
      std::snprintf(name, sizeof name, "images/%05d.png", i);
      cv::imwrite((directory_ / name).string(), cv::Mat(48, 64, CV_8UC1, cv::Scalar(90)));
    }
  }

  std::string cameraSection(double rate_hz) const {
    return "[camera]\nsource = \"images\"\ncalibration = \"calib.yml\"\nrate_hz = " +
           std::to_string(rate_hz) + "\n";
  }
  std::string publishSection() const {
    return "[publish]\nurl = \"" + url_ + "\"\nchannel_prefix = \"TEST_\"\n";
  }

  fs::path write(const std::string& name, const std::string& text) const {
    std::ofstream(directory_ / name) << text;
    return directory_ / name;
  }

  std::vector<std::string> command(const std::string& configuration) const {
    return {WAYMARKD, "--config", write("waymarkd.toml", configuration).string()};
  }
  fs::path stderrFile() const { return directory_ / "stderr"; }

  TemporaryDirectory directory_;
  const std::string url_ = randomUrl();
};

TEST_F(DaemonTest, EveryFrameOfARecordingIsAPoseMessageOrACountedDrop) {
  constexpr int kFrames = 100;
  writeImages(kFrames);
  const Subscriber subscriber(url_, "TEST_");
  Process daemon(command(cameraSection(100.0) + kSlam + publishSection()), stderrFile());
  ASSERT_EQ(daemon.wait(milliseconds(20'000)), 0) << daemon.stderrText();

  // The health message at the very end holds the final counters.
  ASSERT_TRUE(subscriber.waitFor(
      [](const Received& r) {
        return !r.healths.empty() && r.healths.back().camera == health_t::CAMERA_ENDED;
      },
      milliseconds(2000)));
  const Received received = subscriber.received();
  const std::vector<pose_t> poses = received.framePoses();
  std::map<std::string, std::int64_t> counters = received.counters();
  const std::int64_t dropped = counters["dropped.source_late"] +
                               counters["dropped.source_no_buffer"] + counters["dropped.queue"] +
                               counters["dropped.publisher"] + counters["dropped.unsent"];

  EXPECT_EQ(received.undecodable, 0);
  EXPECT_EQ(static_cast<std::int64_t>(poses.size()) + dropped, kFrames);
  EXPECT_EQ(counters["slam.frames"] + counters["dropped.queue"], counters["camera.frames"]);
  EXPECT_EQ(received.detections.size(), poses.size());
  ASSERT_FALSE(poses.empty());
  for (std::size_t i = 1; i < poses.size(); ++i) {
    EXPECT_GT(poses[i].sequence, poses[i - 1].sequence);
    EXPECT_GT(poses[i].utime, poses[i - 1].utime);
  }
  for (const pose_t& pose : poses) {
    EXPECT_EQ(pose.source == pose_t::SOURCE_NONE, !pose.reason.empty());
    EXPECT_GT(pose.latency_ns, 0);
  }
}

TEST_F(DaemonTest, DetectionsCanBeSwitchedOff) {
  writeImages(20);
  const Subscriber subscriber(url_, "TEST_");
  Process daemon(command(cameraSection(100.0) + kSlam + publishSection() + "detections = false\n"),
                 stderrFile());
  ASSERT_EQ(daemon.wait(milliseconds(20'000)), 0) << daemon.stderrText();
  const auto some_poses = [](const Received& r) { return r.framePoses().size() >= 5; };
  EXPECT_TRUE(subscriber.waitFor(some_poses, milliseconds(2000)));
  EXPECT_TRUE(subscriber.received().detections.empty());
}

class DaemonStopTest : public DaemonTest, public ::testing::WithParamInterface<int> {};

TEST_P(DaemonStopTest, ASignalStopsItCleanly) {
  writeImages(300);
  const Subscriber subscriber(url_, "TEST_");
  Process daemon(command(cameraSection(20.0) + kSlam + publishSection()), stderrFile());
  const auto some_poses = [](const Received& r) { return r.framePoses().size() >= 3; };
  ASSERT_TRUE(subscriber.waitFor(some_poses, milliseconds(20'000))) << daemon.stderrText();
  daemon.signal(GetParam());
  EXPECT_EQ(daemon.wait(milliseconds(5000)), 0) << daemon.stderrText();
  EXPECT_NE(daemon.stderrText().find("stopped after"), std::string::npos) << daemon.stderrText();
}

INSTANTIATE_TEST_SUITE_P(Signals, DaemonStopTest, ::testing::Values(SIGTERM, SIGINT));

// Moves the calling thread into the network namespace of a process.
bool enterNetworkOf(pid_t pid) {
  const UniqueFd network(
      open(("/proc/" + std::to_string(pid) + "/ns/net").c_str(), O_RDONLY | O_CLOEXEC));
  return network && setns(network.get(), CLONE_NEWNET) == 0;
}

TEST_F(DaemonTest, WithoutARouteItLivesSaysSoOnceAndPublishesWhenThereIsOne) {
  writeImages(300);
  std::vector<std::string> in_new_network = {"unshare", "-n"};
  for (const std::string& word : command(cameraSection(20.0) + kSlam + publishSection())) {
    in_new_network.push_back(word);
  }
  Process daemon(in_new_network, stderrFile());
  const std::string without_route = "there is no multicast route";
  std::optional<int> ended;
  for (int tries = 0; tries < 200 && !ended; ++tries) {  // 20 s, on a busy computer
    if (daemon.stderrText().find(without_route) != std::string::npos) break;
    ended = daemon.wait(milliseconds(100));
  }
  if (ended == 1) GTEST_SKIP() << "no network of one's own allowed: " << daemon.stderrText();
  ASSERT_FALSE(daemon.wait(milliseconds(1500))) << "it must live: " << daemon.stderrText();
  const std::string said = daemon.stderrText();
  const std::size_t place = said.find(without_route);
  ASSERT_NE(place, std::string::npos) << said;
  EXPECT_EQ(said.find("route", place + 25), std::string::npos) << "once is enough: " << said;

  // The way back is only for a thread of its own: it stays in the daemon's network.
  std::thread([&] {
    ASSERT_TRUE(enterNetworkOf(daemon.pid()));
    ASSERT_EQ(std::system("ip link set lo up && ip link set lo multicast on && "
                          "ip route add 224.0.0.0/4 dev lo"),
              0);
    const Subscriber subscriber(url_, "TEST_");
    EXPECT_TRUE(subscriber.waitFor([](const Received& r) { return r.framePoses().size() >= 3; },
                                   milliseconds(10'000)));
  }).join();
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(milliseconds(5000)), 0);
  EXPECT_NE(daemon.stderrText().find("publishing to " + url_ + " again"), std::string::npos)
      << daemon.stderrText();
}

// One line on stderr that holds `reason`, and exit code 2.
class DaemonBadInputTest : public DaemonTest {
 protected:
  void expectRejected(const std::string& configuration, const std::string& reason) {
    SCOPED_TRACE(configuration);
    Process daemon(command(configuration), stderrFile());
    EXPECT_EQ(daemon.wait(milliseconds(20'000)), 2);
    const std::string said = daemon.stderrText();
    EXPECT_NE(said.find(reason), std::string::npos) << said;
    EXPECT_EQ(std::ranges::count(said, '\n'), 1) << said;
  }
};

TEST_F(DaemonBadInputTest, IsOneLineWithThePlaceAndExitCodeTwo) {
  const std::string camera = cameraSection(20.0);
  writeImages(2);
  expectRejected("[camera\nsource = 1\n", "waymarkd.toml:1:");
  expectRejected(camera + "colour = 1\n" + kSlam, "waymarkd.toml:5:1: camera.colour: unknown key");
  expectRejected(camera + kSlam + "[queue]\ndepth = \"4\"\n",
                 "waymarkd.toml:9:9: queue.depth: must be a whole number");
  expectRejected(camera + "[slam]\ndictionary = \"4X4_50\"\nmarker_size_m = \"big\"\n",
                 "waymarkd.toml:7:17: slam.marker_size_m: must be a number");
  expectRejected(camera + "[slam]\ndictionary = \"5X5\"\nmarker_size_m = 1\n",
                 "\"5X5\" is not a known dictionary");
  expectRejected("[camera]\nsource = \"images\"\ncalibration = \"none.yml\"\n" + kSlam, "none.yml");
  expectRejected("[camera]\nsource = \"none.avi\"\ncalibration = \"calib.yml\"\n" + kSlam,
                 "none.avi: no such file");
  expectRejected("[camera]\nsource = \"calib.yml\"\ncalibration = \"calib.yml\"\n" + kSlam,
                 "calib.yml");
}

TEST_F(DaemonBadInputTest, ACalibrationForAnotherResolution) {
  writeImages(2);
  std::string calibration = kCalibration;
  calibration.replace(calibration.find("64"), 2, "65");
  write("calib.yml", calibration);
  expectRejected(cameraSection(20.0) + kSlam + publishSection(),
                 "the pictures are 64x48, but the calibration is for 65x48");
}

TEST_F(DaemonBadInputTest, BadUsage) {
  Process unknown_option({WAYMARKD, "--colour"}, stderrFile());
  EXPECT_EQ(unknown_option.wait(milliseconds(20'000)), 2);
  EXPECT_EQ(std::ranges::count(unknown_option.stderrText(), '\n'), 1);
  Process no_file({WAYMARKD, "--config", "/nowhere.toml"}, stderrFile());
  EXPECT_EQ(no_file.wait(milliseconds(20'000)), 2);
  EXPECT_NE(no_file.stderrText().find("/nowhere.toml: cannot be read"), std::string::npos);
}

TEST_F(DaemonTest, CheckReadsAndExits) {
  writeImages(1);
  std::vector<std::string> check = command(cameraSection(20.0) + kSlam);
  check.emplace_back("--check");
  Process daemon(check, stderrFile(), directory_ / "out");
  EXPECT_EQ(daemon.wait(milliseconds(20'000)), 0) << daemon.stderrText();
  EXPECT_EQ(daemon.stderrText(), "");
  const std::string said = readFile(directory_ / "out");
  EXPECT_TRUE(said.starts_with((directory_ / "waymarkd.toml").string() + ": good\n")) << said;
  EXPECT_NE(said.find("  markers  4X4_50, 0.1 m"), std::string::npos) << said;
}

TEST_F(DaemonTest, CheckRefusesWhatAStartRefuses) {
  writeImages(1);
  const std::string long_name = directory_ / std::string(120, 'x');
  const auto said = [&](const std::string& more, bool check) {
    std::vector<std::string> words = command(cameraSection(20.0) + kSlam + more);
    if (check) words.emplace_back("--check");
    Process daemon(words, stderrFile());
    EXPECT_EQ(daemon.wait(milliseconds(20'000)), 2) << more;
    return daemon.stderrText();
  };
  const std::string file = directory_ / "waymarkd.toml";
  for (const std::string& more :
       {"[control]\nsocket = \"" + long_name + "\"\n", "[control]\nsocket = \"" + file + "\"\n",
        "[record]\ndirectory = \"" + file + "\"\n"}) {
    const std::string by_check = said(more, true);
    EXPECT_EQ(by_check, said(more, false));
    EXPECT_EQ(std::ranges::count(by_check, '\n'), 1);
  }
}

}  // namespace
}  // namespace waymark::testing
