// Recording while live, as users meet it: what the daemon wrote down is what it saw and said, and
// can be run again; neither kill -9 nor a full disk costs more than it must.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "capture/eventlog/log_reader.h"
#include "capture/eventlog/log_writer.h"
#include "capture/log_source.h"
#include "capture/recorded_image.h"
#include "io/calibrations/calibration_file.h"
#include "io/trajectory.h"
#include "slam/slam.h"
#include "tests/multicast.h"
#include "tests/process.h"
#include "tests/small_disk.h"
#include "tests/subscriber.h"
#include "tests/temporary_directory.h"
#include "tools/recorded_inputs.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

// Everything in a recording.
struct Contents {
  std::map<std::string, int> events;  // by channel
  std::vector<pose_t> poses;
  std::vector<std::uint64_t> sequences;          // of images
  std::vector<std::vector<std::uint8_t>> jpegs;  // of images that are
  std::uint64_t damages = 0;
  std::uint64_t lost_tail = 0;  // bytes after the last whole event
};

Contents contentsOf(const fs::path& file) {
  Contents contents;
  auto reader = eventlog::LogReader::open(file);
  EXPECT_TRUE(reader) << reader.error().message;
  if (!reader) return contents;
  bot_core::image_t image;
  for (;;) {
    const auto event = reader->next();
    EXPECT_TRUE(event);
    if (!event || !*event) break;
    const eventlog::Event& e = **event;
    ++contents.events[std::string(e.channel)];
    if (e.channel == "TEST_POSE") {
      pose_t pose;
      EXPECT_GT(pose.decode(e.data.data(), 0, static_cast<int>(e.data.size())), 0);
      contents.poses.push_back(pose);
    } else if (capture::isImage(e.data)) {
      capture::FrameStamp stamp;
      EXPECT_TRUE(capture::readImage(e.data, 0, &image, &stamp));
      contents.sequences.push_back(stamp.sequence);
      if (image.pixelformat == bot_core::image_t::PIXEL_FORMAT_MJPEG) {
        contents.jpegs.push_back(image.data);
      }
    }
  }
  contents.damages = reader->damages();
  contents.lost_tail = reader->size() - reader->endOfLast();
  return contents;
}

class RecordingTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!ensureMulticastRoute()) GTEST_SKIP() << "no multicast route, and none may be made";
  }

  // A recording to play: frames of changing grey, compressed or not, `rate_hz` a second.
  fs::path source(int width, int height, double rate_hz, int frames, bool compressed) {
    slam::Calibration calibration;
    calibration.width = width;
    calibration.height = height;
    calibration.fx = calibration.fy = width;
    calibration.cx = width / 2.0;
    calibration.cy = height / 2.0;
    EXPECT_TRUE(io::writeCalibration(directory_ / "calib.yml", calibration));
    fs::path file = directory_ / "source.lcmlog";
    auto log = eventlog::LogWriter::create(file);
    cv::Mat picture(height, width, CV_8UC1);
    cv::randu(picture, 60, 180);
    cv::GaussianBlur(picture, picture, {}, 8.0);
    bot_core::image_t image;
    for (int i = 0; i < frames; ++i) {
      picture.at<std::uint8_t>(i % height, i % width) = static_cast<std::uint8_t>(i);
      std::vector<std::uint8_t> jpeg;
      if (compressed) cv::imencode(".jpg", picture, jpeg, {cv::IMWRITE_JPEG_QUALITY, 80});
      const auto ns = static_cast<std::int64_t>(i * 1e9 / rate_hz);
      const capture::FrameStamp stamp{.sequence = static_cast<std::uint64_t>(i),
                                      .monotonic_ns = ns,
                                      .utime = 1'700'000'000'000'000 + ns / 1000};
      capture::fillImage(stamp, {picture.data, width, height, width}, jpeg, &image);
      std::vector<std::uint8_t> bytes(static_cast<std::size_t>(image.getEncodedSize()));
      image.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
      EXPECT_TRUE(log->append(stamp.utime, "CAMERA", bytes));
    }
    EXPECT_TRUE(log->flush());
    return file;
  }
  static std::string recordedSource() {
    return "[camera]\nsource = \"source.lcmlog\"\ncalibration = \"calib.yml\"\n"
           "[slam]\ndictionary = \"4X4_50\"\nmarker_size_m = 0.1\n";
  }

  [[nodiscard]] fs::path configuration(const std::string& camera_and_slam,
                                       const std::string& record) const {
    std::ofstream(directory_ / "waymarkd.toml")
        << camera_and_slam << "[publish]\nurl = \"" << url_ << "\"\nchannel_prefix = \"TEST_\"\n"
        << "[record]\ndirectory = \"" << recordings_.string() << "\"\n"
        << record;
    return directory_ / "waymarkd.toml";
  }
  [[nodiscard]] std::vector<std::string> command(const std::string& camera_and_slam,
                                                 const std::string& record) const {
    return {WAYMARKD, "--config", configuration(camera_and_slam, record).string()};
  }

  [[nodiscard]] std::vector<fs::path> recordings() const {
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(recordings_)) files.push_back(entry.path());
    std::ranges::sort(files);
    return files;
  }

  TemporaryDirectory directory_;
  fs::path recordings_ = directory_ / "recordings";
  const std::string url_ = randomUrl();
};

// The same poses, bit for bit, from the recording alone.
void expectSamePoses(const fs::path& log, const std::vector<pose_t>& live) {
  const auto recorded = tools::recordedInputs(log.string());
  ASSERT_TRUE(recorded) << recorded.error().message;
  ASSERT_TRUE(recorded->calibration && recorded->settings);
  slam::Slam slam(slam::CameraModel(*recorded->calibration),
                  *slam::Dictionary::byName(recorded->settings->dictionary),
                  recorded->settings->options);
  const auto source = capture::openLog(log, {});
  ASSERT_TRUE(source) << source.error().message;
  for (const pose_t& pose : live) {
    capture::ReadResult read = (*source)->read(milliseconds(0));
    ASSERT_TRUE(std::holds_alternative<capture::FramePtr>(read));
    const auto frame = std::get<capture::FramePtr>(std::move(read));
    ASSERT_EQ(static_cast<std::int64_t>(frame->stamp().sequence), pose.sequence);
    const slam::FrameResult result = slam.process(
        {.time = {frame->stamp().sequence, frame->stamp().monotonic_ns}, .image = frame->image()});
    ASSERT_EQ(result.pose.has_value(), pose.source != pose_t::SOURCE_NONE) << pose.sequence;
    if (!result.pose) continue;
    const Eigen::Quaterniond q = result.pose->T_w_c.quaternion();
    ASSERT_TRUE(std::ranges::equal(pose.p_w_c, result.pose->T_w_c.p)) << pose.sequence;
    ASSERT_EQ(pose.q_w_c[0], q.w()) << pose.sequence;
    ASSERT_EQ(pose.q_w_c[1], q.x()) << pose.sequence;
    ASSERT_EQ(pose.q_w_c[2], q.y()) << pose.sequence;
    ASSERT_EQ(pose.q_w_c[3], q.z()) << pose.sequence;
  }
}

TEST_F(RecordingTest, GivesTheSamePosesAgain) {
  const Subscriber subscriber(url_, "TEST_");
  Process daemon(command("[camera]\nsource = \"sim:walls\"\nrate_hz = 30.0\n"
                         "[camera.simulator]\nwidth = 320\nheight = 240\nloop_s = 2.0\n"
                         "[slam]\ndictionary = \"ARUCO_MIP_36h12\"\nmarker_size_m = 0.2\n"
                         "[queue]\ndepth = 64\n",
                         "file_mib = 2\n"),
                 directory_ / "stderr");
  const auto enough = [](const Received& r) { return r.framePoses().size() >= 90; };
  ASSERT_TRUE(subscriber.waitFor(enough, milliseconds(60'000))) << daemon.stderrText();
  daemon.signal(SIGTERM);
  ASSERT_EQ(daemon.wait(milliseconds(10'000)), 0) << daemon.stderrText();

  const std::vector<fs::path> files = recordings();
  ASSERT_GT(files.size(), 2U) << "in several files";
  Contents all;
  for (const fs::path& file : files) {
    const Contents contents = contentsOf(file);
    EXPECT_EQ(contents.damages, 0U);
    EXPECT_EQ(contents.events.at("WAYMARK_FILE"), 2) << "each can be understood alone";
    for (const auto& [channel, count] : contents.events) all.events[channel] += count;
    for (const pose_t& pose : contents.poses) {
      // Poses without a frame tell that there is no camera yet.
      if (pose.status != pose_t::STATUS_NO_CAMERA) all.poses.push_back(pose);
    }
    all.sequences.insert(all.sequences.end(), contents.sequences.begin(), contents.sequences.end());
  }
  ASSERT_EQ(all.poses.size(), all.sequences.size()) << "a pose for each frame, none dropped";
  EXPECT_EQ(all.events["TEST_DETECTIONS"], static_cast<int>(all.poses.size()));
  EXPECT_GT(all.events["TEST_HEALTH"], 2);
  EXPECT_GT(all.events["POSE"], 60);
  expectSamePoses(files.front(), all.poses);

  // The tool needs nothing else, and writes what was published.
  const ProgramResult run = runProgram({WAYMARK_PROGRAM, "run", files.front().string(), "--quiet",
                                        "--no-global", "--out", (directory_ / "out").string()});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto written = io::readTrajectory(directory_ / "out" / "trajectory.tum");
  ASSERT_TRUE(written);
  std::vector<pose_t> localized = all.poses;
  std::erase_if(localized, [](const pose_t& pose) { return pose.source == pose_t::SOURCE_NONE; });
  ASSERT_EQ(written->size(), localized.size());
  for (std::size_t i = 0; i < localized.size(); ++i) {
    EXPECT_EQ((*written)[i].time_ns, localized[i].monotonic_ns);
    EXPECT_NEAR((*written)[i].T_w_c.p.x(), localized[i].p_w_c[0], 1e-6);
  }
}

TEST_F(RecordingTest, TheToolOfLcmPlaysIt) {
  (void)source(64, 48, 100.0, 100, false);
  {
    Process daemon(command(recordedSource(), ""), directory_ / "stderr");
    ASSERT_EQ(daemon.wait(milliseconds(20'000)), 0) << daemon.stderrText();
  }
  // A busy computer passes over some frames of the source: these are not in the recording.
  Received in_recording;
  in_recording.poses = contentsOf(recordings().at(0)).poses;
  const std::size_t recorded = in_recording.framePoses().size();
  EXPECT_GE(recorded, 50U);
  const Subscriber subscriber(url_, "TEST_");
  Process player({"lcm-logplayer", "--lcm-url=" + url_, recordings().front().string()},
                 directory_ / "player", directory_ / "player.out");
  const auto all = [&](const Received& r) { return r.framePoses().size() >= recorded; };
  EXPECT_TRUE(subscriber.waitFor(all, milliseconds(20'000)))
      << subscriber.received().framePoses().size() << " of " << recorded;
  EXPECT_EQ(subscriber.received().undecodable, 0);
}

struct Stream {
  const char* name;
  int width;
  int height;
  double rate_hz;
  bool compressed;
};

class RecordingStreams : public RecordingTest, public ::testing::WithParamInterface<Stream> {};

TEST_P(RecordingStreams, LosesNothing) {
  const Stream& stream = GetParam();
  constexpr int kSeconds = 3;
  const int frames = static_cast<int>(kSeconds * stream.rate_hz);
  const fs::path played =
      source(stream.width, stream.height, stream.rate_hz, frames, stream.compressed);
  const Subscriber subscriber(url_, "TEST_");
  Process daemon(command(recordedSource(), ""), directory_ / "stderr");
  ASSERT_EQ(daemon.wait(milliseconds(30'000)), 0) << daemon.stderrText();
  ASSERT_TRUE(subscriber.waitFor(
      [](const Received& r) {
        return !r.healths.empty() && r.healths.back().camera == health_t::CAMERA_ENDED;
      },
      milliseconds(2000)));
  std::map<std::string, std::int64_t> counters = subscriber.received().counters();
  const Contents recorded = contentsOf(recordings().at(0));
  // What the source itself passed over, because this computer was too busy, never came to us.
  EXPECT_EQ(static_cast<std::int64_t>(recorded.sequences.size()), counters["camera.frames"]);
  EXPECT_EQ(counters["camera.frames"] + counters["dropped.source_late"] +
                counters["dropped.source_no_buffer"],
            frames);
  EXPECT_GT(counters["camera.frames"], 10);
  EXPECT_EQ(counters["recorder.lost_frames"], 0);
  EXPECT_EQ(counters["recorder.lost_messages"], 0);
  EXPECT_EQ(counters["recorder.lost_paused"], 0);
  if (!stream.compressed) return;
  const Contents original = contentsOf(played);
  ASSERT_EQ(recorded.jpegs.size(), recorded.sequences.size());
  for (std::size_t i = 0; i < recorded.jpegs.size(); ++i) {
    ASSERT_EQ(recorded.jpegs[i], original.jpegs[recorded.sequences[i]]) << "byte for byte";
  }
}

INSTANTIATE_TEST_SUITE_P(Cameras, RecordingStreams,
                         ::testing::Values(Stream{"hd", 1280, 720, 60.0, true},
                                           Stream{"vga", 640, 480, 150.0, false}),
                         [](const auto& test) { return std::string(test.param.name); });

TEST_F(RecordingTest, WhatWasFlushedSurvivesKillNine) {
  constexpr int kKills = 20;
  constexpr milliseconds kFlush(100);
  constexpr milliseconds kSlack(400);  // to be scheduled at all, on a busy computer
  (void)source(320, 240, 150.0, 450, false);
  const std::vector<std::string> daemon_command =
      command(recordedSource(), "flush_ms = " + std::to_string(kFlush.count()) + "\n");
  std::mt19937 random(7);
  int torn = 0;
  std::optional<fs::path> last;
  for (int kill = 0; kill < kKills; ++kill) {
    const Subscriber subscriber(url_, "TEST_");
    std::int64_t flushed = -1;  // the last frame that surely is on the disk
    {
      Process daemon(daemon_command, directory_ / "stderr");
      const auto some = [](const Received& r) { return r.framePoses().size() >= 5; };
      ASSERT_TRUE(subscriber.waitFor(some, milliseconds(20'000))) << daemon.stderrText();
      std::this_thread::sleep_for(milliseconds(random() % 500));
      flushed = subscriber.received().framePoses().back().sequence;
      std::this_thread::sleep_for(kFlush + kSlack);
      daemon.signal(SIGKILL);
      ASSERT_EQ(daemon.wait(milliseconds(5000)), -1);
    }
    if (last) {
      EXPECT_EQ(contentsOf(*last).lost_tail, 0U) << "cut when the next daemon began";
    }
    const std::vector<fs::path> files = recordings();
    ASSERT_EQ(static_cast<int>(files.size()), kill + 1);
    last = files.back();
    const Contents contents = contentsOf(*last);
    EXPECT_LE(contents.damages, 1U) << "the torn tail";
    torn += contents.lost_tail > 0 ? 1 : 0;
    const std::set<std::uint64_t> frames(contents.sequences.begin(), contents.sequences.end());
    std::set<std::int64_t> poses;
    for (const pose_t& pose : contents.poses) poses.insert(pose.sequence);
    for (const pose_t& pose : subscriber.received().framePoses()) {
      if (pose.sequence > flushed) continue;
      ASSERT_TRUE(frames.contains(static_cast<std::uint64_t>(pose.sequence)))
          << "kill " << kill << ", frame " << pose.sequence << " of " << flushed;
      ASSERT_TRUE(poses.contains(pose.sequence)) << "kill " << kill;
    }
  }
  RecordProperty("torn", torn);
}

TEST_F(RecordingTest, AFullDiskIsAPause) {
  const SmallDisk disk(recordings_, "40m");
  if (!disk) GTEST_SKIP() << "mounting is not allowed here";
  (void)source(320, 240, 150.0, 3000, false);  // 20 s, 11 MB a second
  const Subscriber subscriber(url_, "TEST_");
  Process daemon(command(recordedSource(), "keep_free_mib = 8\nfile_mib = 4\n"),
                 directory_ / "stderr");
  const auto counted = [](const std::string& name, std::int64_t least) {
    return [name, least](const Received& r) {
      return !r.healths.empty() && r.counters()[name] >= least;
    };
  };
  ASSERT_TRUE(subscriber.waitFor(counted("recorder.pauses", 1), milliseconds(20'000)))
      << daemon.stderrText();
  ASSERT_TRUE(subscriber.waitFor(counted("recorder.lost_paused", 1), milliseconds(5'000)));
  const std::size_t poses = subscriber.received().framePoses().size();
  ASSERT_TRUE(subscriber.waitFor(
      [&](const Received& r) { return r.framePoses().size() > poses + 50; }, milliseconds(5'000)))
      << "the daemon goes on";
  EXPECT_NE(daemon.stderrText().find("the disk is full"), std::string::npos);
  const std::vector<fs::path> before = recordings();
  for (const fs::path& file : before) {
    EXPECT_EQ(contentsOf(file).damages, 0U) << "ended cleanly";
    fs::remove(file);
  }
  const std::int64_t files = subscriber.received().counters()["recorder.files"];
  ASSERT_TRUE(subscriber.waitFor(counted("recorder.files", files + 2), milliseconds(10'000)))
      << "and goes on recording when there is room again";
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(milliseconds(10'000)), 0);
}

}  // namespace
}  // namespace waymark::testing
