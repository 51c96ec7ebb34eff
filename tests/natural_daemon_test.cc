// Natural markers in waymarkd, as users meet them: pictures in the configuration, poses and places
// on LCM, and a recording that gives the same poses again without looking for anything.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "capture/eventlog/log_reader.h"
#include "capture/eventlog/log_writer.h"
#include "capture/log_source.h"
#include "capture/recorded_image.h"
#include "io/calibrations/calibration_file.h"
#include "slam/slam.h"
#include "tests/multicast.h"
#include "tests/poster_wall.h"
#include "tests/process.h"
#include "tests/subscriber.h"
#include "tests/temporary_directory.h"
#include "tools/natural/recorded_late_results.h"
#include "tools/recorded_inputs.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

// There and back along the wall, again and again, for a minute: a busy computer looks at an image
// in seconds only.
constexpr int kOneWay = 140;  // frames
constexpr int kFrames = 1200;
constexpr double kSourceRate_hz = 20.0;

int placeOnTheWay(int frame) {
  const int k = frame % (2 * kOneWay);
  return k < kOneWay ? k : 2 * kOneWay - 1 - k;
}

slam::Transform truthOf(std::int64_t frame) {
  const int k = placeOnTheWay(static_cast<int>(frame));
  return facingWall(-0.1 + 0.01 * k, 1.0, 0.15 * std::sin(0.05 * k));
}

// The poses of frames, as the daemon wrote them down.
std::vector<pose_t> posesIn(const fs::path& log) {
  std::vector<pose_t> poses;
  auto reader = eventlog::LogReader::open(log);
  EXPECT_TRUE(reader) << reader.error().message;
  while (reader) {
    const auto event = reader->next();
    if (!event || !*event) break;
    if ((*event)->channel != "TEST_POSE") continue;
    pose_t pose;
    EXPECT_GT(pose.decode((*event)->data.data(), 0, static_cast<int>((*event)->data.size())), 0);
    if (pose.status != pose_t::STATUS_NO_CAMERA) poses.push_back(pose);
  }
  return poses;
}

// The last that was told of a natural marker's place.
std::optional<natural_marker_t> placeOf(const std::string& name, const Received& received) {
  std::optional<natural_marker_t> place;
  for (const natural_map_t& map : received.natural_maps) {
    for (const natural_marker_t& marker : map.markers) {
      if (marker.name == name) place = marker;
    }
  }
  return place;
}

int answers(const Received& received) {
  int count = 0;
  for (const natural_detections_t& message : received.natural_detections) count += message.count;
  return count;
}

class NaturalDaemonTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!ensureMulticastRoute()) GTEST_SKIP() << "no multicast route, and none may be made";
    cv::setNumThreads(1);  // as the daemon: the thread sanitizer does not see into OpenCV's own
    writeSource();
    writePosters();
  }

  void writeSource() {
    ASSERT_TRUE(io::writeCalibration(directory_ / "calib.yml", lens()));
    auto log = eventlog::LogWriter::create(directory_ / "source.lcmlog");
    std::vector<std::vector<std::uint8_t>> jpegs(kOneWay);
    for (int i = 0; i < kOneWay; ++i) {
      std::vector<std::uint8_t> pixels =
          wall_.render(truthOf(i), false, static_cast<std::uint64_t>(i));
      const cv::Mat grey(480, 640, CV_8U, pixels.data());
      cv::imencode(".jpg", grey, jpegs[static_cast<std::size_t>(i)],
                   {cv::IMWRITE_JPEG_QUALITY, 90});
    }
    bot_core::image_t image;
    for (int i = 0; i < kFrames; ++i) {
      const auto ns = static_cast<std::int64_t>(i * 1e9 / kSourceRate_hz);
      const capture::FrameStamp stamp{.sequence = static_cast<std::uint64_t>(i),
                                      .monotonic_ns = ns,
                                      .utime = 1'700'000'000'000'000 + ns / 1000};
      const auto& jpeg = jpegs[static_cast<std::size_t>(placeOnTheWay(i))];
      capture::fillImage(stamp, {nullptr, 640, 480, 640}, jpeg, &image);
      std::vector<std::uint8_t> bytes(static_cast<std::size_t>(image.getEncodedSize()));
      image.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
      ASSERT_TRUE(log->append(stamp.utime, "CAMERA", bytes));
    }
    ASSERT_TRUE(log->flush());
  }

  void writePosters() {
    for (int i = 0; i < 2; ++i) {
      simulator::PosterImage poster = PosterWall::posterImage(i);
      const cv::Mat grey(poster.height, poster.width, CV_8U, poster.grey.data());
      ASSERT_TRUE(cv::imwrite((directory_ / imageOf(i)).string(), grey));
    }
  }
  static std::string imageOf(int poster) { return "poster" + std::to_string(poster) + ".png"; }

  // The first poster is where somebody measured it, the second one anywhere.
  [[nodiscard]] std::string naturalSections() const {
    std::string text;
    for (int i = 0; i < 2; ++i) {
      text += "[[natural]]\nname = '" + nameOf(i) + "'\nimage = '" + imageOf(i) +
              "'\nwidth_m = " + std::to_string(kPosterWidth_m) + "\n";
    }
    const auto& p = wall_.placeOf(0).p;
    const std::string place = "p_m = [" + std::to_string(p.x()) + ", " + std::to_string(p.y()) +
                              ", " + std::to_string(p.z()) + "]\nq_wxyz = [1.0, 0.0, 0.0, 0.0]\n";
    return text.insert(text.find("[[natural]]", 1), place);
  }

  [[nodiscard]] fs::path configuration(const std::string& natural) const {
    std::ofstream(directory_ / "waymarkd.toml")
        << "[camera]\nsource = 'source.lcmlog'\ncalibration = 'calib.yml'\n"
        << "[slam]\ndictionary = 'APRILTAG_36h11'\nmarker_size_m = 0.15\nmap_out = 'map.json'\n"
        << natural << "[queue]\ndepth = 64\n"
        << "[publish]\nurl = '" << url_ << "'\nchannel_prefix = 'TEST_'\nmap_interval_s = 0.5\n"
        << "[record]\ndirectory = 'recordings'\n";
    return directory_ / "waymarkd.toml";
  }
  [[nodiscard]] fs::path recording() const {
    return fs::directory_iterator(directory_ / "recordings")->path();
  }

  const TemporaryDirectory directory_;
  const std::string url_ = randomUrl();
  PosterWall wall_{2};
};

// The same poses, bit for bit, from the recording alone; the pictures are gone.
void expectSamePoses(const fs::path& log, const std::vector<pose_t>& live) {
  const auto recorded = tools::recordedInputs(log.string());
  ASSERT_TRUE(recorded) << recorded.error().message;
  ASSERT_EQ(recorded->prints.size(), 2U);
  slam::Options options = recorded->settings->options;
  options.natural.prints = recorded->prints;
  slam::Slam slam(slam::CameraModel(*recorded->calibration),
                  *slam::Dictionary::byName(recorded->settings->dictionary), options);
  auto results = tools::RecordedLateResults::read(log);
  ASSERT_TRUE(results) << results.error().message;
  tools::RecordedLateResults late(std::move(*results));
  const auto source = capture::openLog(log, {});
  ASSERT_TRUE(source) << source.error().message;
  for (const pose_t& pose : live) {
    capture::ReadResult read = (*source)->read(milliseconds(0));
    ASSERT_TRUE(std::holds_alternative<capture::FramePtr>(read));
    const auto frame = std::get<capture::FramePtr>(std::move(read));
    ASSERT_EQ(static_cast<std::int64_t>(frame->stamp().sequence), pose.sequence);
    const slam::FrameResult result = slam.process(late.prepare(
        {.time = {frame->stamp().sequence, frame->stamp().monotonic_ns}, .image = frame->image()},
        slam));
    ASSERT_EQ(result.pose.has_value(), pose.source != pose_t::SOURCE_NONE) << pose.sequence;
    if (!result.pose) continue;
    ASSERT_TRUE(std::ranges::equal(pose.p_w_c, result.pose->T_w_c.p)) << pose.sequence;
    const Eigen::Quaterniond q = result.pose->T_w_c.quaternion();
    ASSERT_EQ(pose.q_w_c[0], q.w()) << pose.sequence;
    ASSERT_EQ(pose.q_w_c[3], q.z()) << pose.sequence;
  }
}

TEST_F(NaturalDaemonTest, PosesFromPicturesAloneAndTheSameFromTheRecording) {
  Received received;
  {
    const Subscriber subscriber(url_, "TEST_");
    Process daemon({WAYMARKD, "--config", configuration(naturalSections()).string()},
                   directory_ / "stderr");
    const auto enough = [](const Received& r) {
      return answers(r) >= 8 && placeOf(nameOf(1), r) && r.natural_detections.back().sequence > 200;
    };
    EXPECT_TRUE(subscriber.waitFor(enough, milliseconds(90'000))) << daemon.stderrText();
    daemon.signal(SIGTERM);
    ASSERT_EQ(daemon.wait(milliseconds(30'000)), 0) << daemon.stderrText();
    received = subscriber.received();
  }
  EXPECT_EQ(received.undecodable, 0);

  // The camera in the pictures' frames, of frames that were looked at.
  std::set<std::int64_t> searched;
  std::optional<std::int64_t> settled;  // by the fourth answer
  int heard = 0;
  for (const natural_detections_t& message : received.natural_detections) {
    for (const natural_detection_t& detection : message.detections) {
      EXPECT_TRUE(searched.contains(detection.sequence)) << detection.sequence;
      const int poster = detection.name == nameOf(0) ? 0 : 1;
      EXPECT_EQ(detection.name, nameOf(poster));
      const slam::Transform truth = wall_.placeOf(poster).inverse() * truthOf(detection.sequence);
      EXPECT_NEAR(detection.p_m_c[2], truth.p.z(), 0.02);
      if (++heard == 4) settled = message.sequence;
    }
    if (message.searched != 0) searched.insert(message.sequence);
  }
  ASSERT_TRUE(settled);

  // The world is the survey's, and the pose comes from what is followed between two answers.
  int posed = 0;
  for (const pose_t& pose : received.framePoses()) {
    if (pose.source == pose_t::SOURCE_NONE || pose.sequence < *settled) continue;
    ++posed;
    EXPECT_EQ(pose.status, pose_t::STATUS_BRIDGING);
    const slam::Transform truth = truthOf(pose.sequence);
    EXPECT_NEAR(pose.p_w_c[0], truth.p.x(), 4.0 * std::sqrt(pose.covariance[0])) << pose.sequence;
    EXPECT_NEAR(pose.p_w_c[2], truth.p.z(), 4.0 * std::sqrt(pose.covariance[14])) << pose.sequence;
    EXPECT_NEAR(pose.p_w_c[0], truth.p.x(), 0.03) << pose.sequence;
    EXPECT_NEAR(pose.p_w_c[2], truth.p.z(), 0.03) << pose.sequence;
  }
  EXPECT_GT(posed, 20);

  // Subscribers learn where the other one hangs, and the map keeps it.
  const auto place = placeOf(nameOf(1), received);
  ASSERT_TRUE(place);
  EXPECT_NEAR(place->p_w_m[0], wall_.placeOf(1).p.x(), 0.03);
  EXPECT_NEAR(place->p_w_m[1], wall_.placeOf(1).p.y(), 0.03);
  EXPECT_EQ(place->width, kPosterWidth_m);
  EXPECT_GT(place->height, kPosterWidth_m);
  EXPECT_TRUE(fs::exists(directory_ / "map.json"));

  for (int i = 0; i < 2; ++i) fs::remove(directory_ / imageOf(i));
  const std::vector<pose_t> poses = posesIn(recording());
  EXPECT_GE(poses.size(), received.framePoses().size());
  expectSamePoses(recording(), poses);

  const ProgramResult run = runProgram({WAYMARK_PROGRAM, "run", recording().string(), "--quiet",
                                        "--no-global", "--out", (directory_ / "out").string()});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  std::ifstream written(directory_ / "out" / "poses.csv");
  int of_features = 0;
  for (std::string line; std::getline(written, line);) {
    of_features += line.find(",natural_features,") != std::string::npos ? 1 : 0;
  }
  EXPECT_GE(of_features, posed) << "the tool needs nothing else";
}

TEST_F(NaturalDaemonTest, WhatIsWrongWithAPictureIsOneLine) {
  const auto said = [&](const std::string& natural) {
    const ProgramResult result =
        runProgram({WAYMARKD, "--check", "--config", configuration(natural).string()});
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_EQ(std::ranges::count(result.err, '\n'), 1) << result.err;
    return result.err;
  };
  const std::string config = (directory_ / "waymarkd.toml").string();
  const auto has = [](const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
  };
  const std::string one = "[[natural]]\nname = 'a'\nimage = 'poster0.png'\nwidth_m = 0.3\n";
  EXPECT_TRUE(has(said(one + "[[natural]]\nname = 'b'\nimage = 'none.png'\nwidth_m = 0.3\n"),
                  config + ": marker 'b': "));
  EXPECT_TRUE(has(said(one + "[[natural]]\nname = 'b'\nimage = 'poster0.png'\nwidth_m = 0.3\n"),
                  "is the same picture as that of 'a'"));
  EXPECT_TRUE(has(said(one + "[relocalizer]\nmarkers = 'posters.json'\n"),
                  config + ": relocalizer.markers: "));
  EXPECT_TRUE(has(said("[relocalizer]\nmarkers = 'posters.json'\n"), "posters.json: "));
  EXPECT_TRUE(has(said(one + "p_m = [0.0, 0.0, 0.0]\n"), "p_m and q_wxyz go together"));
  EXPECT_TRUE(has(said("[slam.natural]\nenabled = false\n" + one), "slam.natural.enabled"));
  EXPECT_TRUE(has(said("[slam.markers]\norigin = 1\n" + one +
                       "p_m = [0.0, 0.0, 0.0]\nq_wxyz = [1.0, 0.0, 0.0, 0.0]\n"),
                  "the natural marker \"a\" is surveyed"));
}

}  // namespace
}  // namespace waymark::testing
