#include "daemon/configuration.h"

#include <string>

#include <gtest/gtest.h>

namespace waymark::daemon {
namespace {

const std::string kCamera = "[camera]\nsource = \"sim:walls\"\n";
const std::string kSlam = "[slam]\ndictionary = \"4X4_50\"\nmarker_size_m = 0.1\n";

std::string errorOf(const std::string& text) {
  const Result<Configuration> result = parseConfiguration(text, "/etc/w.toml");
  return result ? "no error" : result.error().message;
}

TEST(Configuration, TheCommentedExampleIsValid) {
  const Result<Configuration> c = readConfiguration(WAYMARK_EXAMPLE_CONFIGURATION);
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_EQ(c->camera.source, "sim:walls");
  EXPECT_EQ(c->camera.rate_hz, 150.0);
  EXPECT_EQ(c->slam.dictionary, "ARUCO_MIP_36h12");
  EXPECT_EQ(c->slam.options.marker_size_m, 0.165);
}

// The example shows every key, and the defaults it names are the true ones.
TEST(Configuration, TheExampleWithEverythingUncommentedChangesNoDefault) {
  const std::string everything = R"(
[camera]
source = "sim:walls"
[camera.simulator]
seed = 1
width = 640
height = 480
loop_s = 4.0
[slam]
dictionary = "ARUCO_MIP_36h12"
marker_size_m = 0.165
ambiguity_ratio = 3.0
[queue]
depth = 4
[publish]
url = "udpm://239.255.76.67:7667?ttl=0"
channel_prefix = "WAYMARK_"
pose_channel = "POSE"
detections = true
[log]
level = "info"
)";
  const Result<Configuration> c = parseConfiguration(everything, "w.toml");
  ASSERT_TRUE(c) << c.error().message;
  const Configuration d;
  EXPECT_EQ(c->camera.simulator.seed, d.camera.simulator.seed);
  EXPECT_EQ(c->camera.simulator.width, d.camera.simulator.width);
  EXPECT_EQ(c->camera.simulator.height, d.camera.simulator.height);
  EXPECT_EQ(c->camera.simulator.loop_s, d.camera.simulator.loop_s);
  EXPECT_EQ(c->slam.options.ambiguity_ratio, d.slam.options.ambiguity_ratio);
  EXPECT_EQ(c->queue.depth, d.queue.depth);
  EXPECT_EQ(c->publish.url, d.publish.url);
  EXPECT_EQ(c->publish.channel_prefix, d.publish.channel_prefix);
  EXPECT_EQ(c->publish.pose_channel, d.publish.pose_channel);
  EXPECT_EQ(c->publish.detections, d.publish.detections);
  EXPECT_EQ(c->log.level, d.log.level);
}

TEST(Configuration, ReadsEveryKindOfValue) {
  const Result<Configuration> c = parseConfiguration(
      "[camera]\nsource = \"a/b.avi\"\ncalibration = \"c.yml\"\nrate_hz = 30\n" + kSlam +
          "[publish]\ndetections = false\n[log]\nlevel = \"debug\"\n[queue]\ndepth = 1\n",
      "/etc/waymark/w.toml");
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_EQ(c->camera.source, "/etc/waymark/a/b.avi");
  EXPECT_EQ(c->camera.calibration, "/etc/waymark/c.yml");
  EXPECT_EQ(c->camera.rate_hz, 30.0);
  EXPECT_FALSE(c->publish.detections);
  EXPECT_EQ(c->log.level, LogLevel::kDebug);
  EXPECT_EQ(c->queue.depth, 1);
}

TEST(Configuration, SourcesWithASchemeAreNoPaths) {
  for (const char* source : {"sim:lab", "v4l2:/dev/video0", "libcamera:0", "/abs/x.avi"}) {
    const Result<Configuration> c = parseConfiguration(
        std::string("[camera]\ncalibration = \"c.yml\"\nsource = \"") + source + "\"\n" + kSlam,
        "/etc/w.toml");
    ASSERT_TRUE(c) << c.error().message;
    EXPECT_EQ(c->camera.source, source);
  }
}

TEST(Configuration, ErrorsNamePlaceKeyAndReason) {
  EXPECT_EQ(errorOf(kCamera + "ratehz = 3\n" + kSlam),
            "/etc/w.toml:3:1: camera.ratehz: unknown key");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[publisher]\nurl = 3\n"),
            "/etc/w.toml:6:2: publisher: unknown key");
  EXPECT_EQ(errorOf(kCamera + "rate_hz = \"fast\"\n" + kSlam),
            "/etc/w.toml:3:11: camera.rate_hz: must be a number");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[queue]\ndepth = 0\n"),
            "/etc/w.toml:7:9: queue.depth: must be from 1 to 64, not 0");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[queue]\ndepth = 1.5\n"),
            "/etc/w.toml:7:9: queue.depth: must be a whole number");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[publish]\ndetections = 1\n"),
            "/etc/w.toml:7:14: publish.detections: must be true or false");
  EXPECT_EQ(errorOf("queue = 4\n" + kCamera + kSlam), "/etc/w.toml:1:9: queue: must be a section");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[log]\nlevel = \"loud\"\n"),
            "/etc/w.toml:7:9: log.level: must be one of \"error\", \"warning\", \"info\", \"debug\"");
}

TEST(Configuration, RefusesImpossibleMarkers) {
  EXPECT_EQ(errorOf(kCamera + "[slam]\ndictionary = \"4X4_50\"\nmarker_size_m = 0\n"),
            "/etc/w.toml:5:17: slam.marker_size_m: must be from 0.001 to 100 m, not 0");
  EXPECT_EQ(errorOf(kCamera + "[slam]\ndictionary = \"4X4_50\"\nmarker_size_m = nan\n"),
            "/etc/w.toml:5:17: slam.marker_size_m: must be from 0.001 to 100 m, not nan");
  const std::string unknown =
      errorOf(kCamera + "[slam]\ndictionary = \"9X9\"\nmarker_size_m = 1\n");
  EXPECT_TRUE(unknown.starts_with(
      "/etc/w.toml:4:14: slam.dictionary: \"9X9\" is not a known dictionary; known are "))
      << unknown;
}

TEST(Configuration, RefusesUnusableUrlsAndChannels) {
  EXPECT_EQ(errorOf(kCamera + kSlam + "[publish]\nurl = \"udpm://10.0.0.1:1\"\n"),
            "/etc/w.toml:7:7: publish.url: must be like \"udpm://239.255.76.67:7667?ttl=0\" with a "
            "multicast address, not \"udpm://10.0.0.1:1\"");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[publish]\npose_channel = \"A B\"\n"),
            "/etc/w.toml:7:16: publish.pose_channel: must be at most 50 characters without spaces");
}

TEST(Configuration, SaysWhatIsMissing) {
  EXPECT_EQ(errorOf(kCamera), "/etc/w.toml: slam.dictionary: missing");
  EXPECT_EQ(errorOf(kSlam), "/etc/w.toml: camera.source: missing");
  EXPECT_EQ(errorOf("[camera]\nsource = \"x.avi\"\n" + kSlam),
            "/etc/w.toml: camera.calibration: missing; only simulated cameras bring one");
}

TEST(Configuration, SyntaxErrorsNameTheirLine) {
  const std::string message = errorOf("[camera]\nsource = \"sim:walls\n");
  EXPECT_TRUE(message.starts_with("/etc/w.toml:2:")) << message;
  EXPECT_EQ(message.find('\n'), message.npos) << "one line";
}

TEST(Configuration, FilesThatCannotBeRead) {
  EXPECT_EQ(readConfiguration("/nowhere/w.toml").error().message,
            "/nowhere/w.toml: cannot be read: No such file or directory");
  EXPECT_EQ(readConfiguration("/").error().message, "/: is a directory");
}

}  // namespace
}  // namespace waymark::daemon
