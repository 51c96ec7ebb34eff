// V4L2 with a real driver: what comes in is what was sent, and the daemon outlives every fault.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include <gtest/gtest.h>

#include "base/clock.h"
#include "capture/open_source.h"
#include "io/calibrations/calibration_file.h"
#include "simulator/simulation.h"
#include "tests/multicast.h"
#include "tests/process.h"
#include "tests/subscriber.h"
#include "tests/temporary_directory.h"
#include "tests/vm/vivid_loop.h"

namespace waymark::testing {
namespace {

using std::chrono::milliseconds;

// The guest's processors are emulated, perhaps on a busy computer: all takes its time.
constexpr milliseconds kPatience(120'000);
// From when the camera is back to the first frame. Of it 2 s are the daemon's; the rest is the
// emulation's.
constexpr double kReopened_s = 4.0;
constexpr const char* kByPath = "/dev/v4l/by-path/platform-vivid.0-video-index0";

// A camera before walls of markers: some way there and back again, so that it never jumps however
// often the frames are played.
class Scene {
 public:
  static constexpr std::size_t kFrames = 10;  // there

  Scene() {
    simulator::Options options;
    options.rate_hz = 6.0;
    simulation_ = simulator::Simulation::create(options, simulator::Ending::kOfTheScene).value();
    pixels_.assign(kFrames, Bytes(VividLoop::kWidth * VividLoop::kHeight));
    const auto render = [this](std::size_t first) {
      simulator::Simulation::Workspace workspace;
      for (std::size_t k = first; k < kFrames; k += 2) {
        simulation_->render(static_cast<std::int64_t>(k), &workspace, pixels_[k].data());
      }
    };
    const std::jthread other(render, 1);
    render(0);
  }

  [[nodiscard]] ImageView view(std::size_t k) const {
    return {pixels_[k].data(), VividLoop::kWidth, VividLoop::kHeight, VividLoop::kWidth};
  }
  [[nodiscard]] slam::Transform poseOf(std::size_t k) const {
    return simulation_->poseAt(static_cast<std::int64_t>(k));
  }
  [[nodiscard]] const slam::Calibration& camera() const { return simulation_->camera(); }
  [[nodiscard]] double markerSize_m() const { return simulation_->markers().front().size_m; }
  [[nodiscard]] const std::string& dictionary() const { return simulation_->options().dictionary; }

  // There and back, as a camera of that format sends them.
  [[nodiscard]] std::vector<Bytes> encoded(PixelFormat format) const {
    std::vector<Bytes> frames;
    for (std::size_t k = 0; k < kFrames; ++k) {
      frames.push_back(encodeFrame(format, view(k), static_cast<std::uint32_t>(k)));
    }
    for (std::size_t k = kFrames - 2; k > 0; --k) frames.push_back(frames[k]);
    return frames;
  }

  // Which of the frames this is, bit by bit.
  [[nodiscard]] std::optional<std::size_t> find(const ImageView& image) const {
    for (std::size_t k = 0; k < kFrames; ++k) {
      bool same = true;
      for (int y = 0; same && y < image.height; ++y) {
        same = std::equal(image.row(y), image.row(y) + image.width, view(k).row(y));
      }
      if (same) return k;
    }
    return std::nullopt;
  }

 private:
  std::unique_ptr<const simulator::Simulation> simulation_;
  std::vector<Bytes> pixels_;
};

class VividTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (!scene_) scene_ = std::make_unique<Scene>();
  }

  void send(PixelFormat format) {
    const Status prepared = vivid_.prepare(format);
    ASSERT_TRUE(prepared) << prepared.error().message;
    ASSERT_TRUE(vivid_.play(scene_->encoded(format))) << "the driver takes no frames";
  }

  static std::unique_ptr<Scene> scene_;  // shared by all tests: rendering takes long
  VividLoop vivid_;
};
std::unique_ptr<Scene> VividTest::scene_;

// --- The source ----------------------------------------------------------------------------------

class VividSourceTest : public VividTest, public ::testing::WithParamInterface<PixelFormat> {};

TEST_P(VividSourceTest, FramesAreThoseSentBitByBit) {
  ASSERT_NO_FATAL_FAILURE(send(GetParam()));
  const std::string spec = "v4l2:" + vivid_.captureNode().string();
  capture::SourceOptions options;
  options.camera.format = nameOf(GetParam());
  // The driver scales to whatever is asked for.
  options.camera.width = VividLoop::kWidth;
  options.camera.height = VividLoop::kHeight;
  const auto source = capture::openSource(spec, options);
  ASSERT_TRUE(source) << source.error().message;
  const capture::StreamInfo info = (*source)->info();
  EXPECT_EQ(info.width, VividLoop::kWidth);
  EXPECT_EQ(info.height, VividLoop::kHeight);
  EXPECT_TRUE(info.live);
  EXPECT_NE(info.description.find(nameOf(GetParam())), std::string::npos) << info.description;

  std::set<std::size_t> seen;
  std::optional<capture::FrameStamp> last;
  int frames = 0;
  for (; frames < 300 && (frames < 40 || seen.size() < Scene::kFrames); ++frames) {
    const std::int64_t before_ns = monotonicNs();
    capture::ReadResult result = (*source)->read(milliseconds(10'000));
    auto* frame = std::get_if<capture::FramePtr>(&result);
    ASSERT_NE(frame, nullptr) << "frame " << frames;
    const std::optional<std::size_t> k = scene_->find((*frame)->image());
    ASSERT_TRUE(k) << "frame " << frames << " is none of those sent";
    seen.insert(*k);
    const capture::FrameStamp& stamp = (*frame)->stamp();
    EXPECT_LE(stamp.monotonic_ns, monotonicNs());
    EXPECT_GT(stamp.monotonic_ns, before_ns - 1'000'000'000);
    if (last) {
      EXPECT_GT(stamp.sequence, last->sequence);
      EXPECT_GT(stamp.monotonic_ns, last->monotonic_ns);
      EXPECT_GT(stamp.utime, last->utime);
    }
    last = stamp;
  }
  EXPECT_EQ(seen.size(), Scene::kFrames) << "after " << frames << " frames";
  EXPECT_EQ((*source)->counters().frames, static_cast<std::uint64_t>(frames));
}

std::string formatName(const ::testing::TestParamInfo<PixelFormat>& format) {
  return nameOf(format.param);
}
INSTANTIATE_TEST_SUITE_P(Formats, VividSourceTest,
                         ::testing::Values(PixelFormat::kGrey, PixelFormat::kYuyv,
                                           PixelFormat::kNv12),
                         formatName);

// --- The daemon ----------------------------------------------------------------------------------

class VividDaemonTest : public VividTest, public ::testing::WithParamInterface<PixelFormat> {
 protected:
  void startDaemon(PixelFormat format) {
    ASSERT_TRUE(ensureMulticastRoute());
    ASSERT_NO_FATAL_FAILURE(send(format));
    ASSERT_TRUE(io::writeCalibration(directory_ / "calib.yml", scene_->camera()));
    const std::string url = randomUrl();
    std::ofstream(directory_ / "waymarkd.toml")
        << "[camera]\nsource = 'v4l2:" << kByPath << "'\ncalibration = 'calib.yml'\nformat = '"
        << nameOf(format) << "'\n[slam]\ndictionary = '" << scene_->dictionary()
        << "'\nmarker_size_m = " << scene_->markerSize_m()
        << "\n[publish]\nchannel_prefix = 'TEST_'\nurl = '" << url << "'\n";
    subscriber_.emplace(url, "TEST_");
    daemon_.emplace(
        std::vector<std::string>{WAYMARKD, "--config", (directory_ / "waymarkd.toml").string()},
        directory_ / "daemon.err");
    ASSERT_NO_FATAL_FAILURE(awaitPoses(30, 0));
  }

  void stopDaemon() {
    daemon_->signal(SIGTERM);
    EXPECT_EQ(daemon_->wait(kPatience), 0) << daemon_->stderrText();
  }

  // Poses of frames taken after `after_ns`.
  [[nodiscard]] static std::vector<pose_t> posesAfter(const Received& received,
                                                      std::int64_t after_ns) {
    std::vector<pose_t> poses;
    for (const pose_t& pose : received.poses) {
      if (pose.source == pose_t::SOURCE_MARKERS && pose.monotonic_ns > after_ns) {
        poses.push_back(pose);
      }
    }
    return poses;
  }
  void awaitPoses(std::size_t count, std::int64_t after_ns) {
    const auto enough = [&](const Received& r) { return posesAfter(r, after_ns).size() >= count; };
    ASSERT_TRUE(subscriber_->waitFor(enough, kPatience)) << daemon_->stderrText();
  }

  // How far the poses are from those of the frames that were sent; the world is the camera of one
  // of them, and must be the same one for all.
  [[nodiscard]] double worstError_m() const {
    const std::vector<pose_t> poses = posesAfter(subscriber_->received(), 0);
    double best = std::numeric_limits<double>::max();
    for (std::size_t world = 0; world < Scene::kFrames; ++world) {
      double worst = 0.0;
      for (const pose_t& pose : poses) {
        double nearest = std::numeric_limits<double>::max();
        for (std::size_t k = 0; k < Scene::kFrames; ++k) {
          const slam::Transform T_w_c = scene_->poseOf(world).inverse() * scene_->poseOf(k);
          const Eigen::Vector3d p(pose.p_w_c);
          nearest = std::min(nearest, (T_w_c.p - p).norm());
        }
        worst = std::max(worst, nearest);
      }
      best = std::min(best, worst);
    }
    return best;
  }

  // Does `fault`, which returns when the camera is there again, and waits for poses. The process
  // must be the same one, and have as many open files as before.
  void expectRecovery(const std::string& name, const std::function<void()>& fault) {
    SCOPED_TRACE(name);
    const std::size_t descriptors = openDescriptors(daemon_->pid());
    const std::int64_t reopened = subscriber_->received().counters()["camera.reopened"];
    ASSERT_NO_FATAL_FAILURE(fault());
    const std::int64_t back_ns = monotonicNs();
    ASSERT_NO_FATAL_FAILURE(awaitPoses(10, back_ns));
    const auto is_after = [&](const pose_t& pose) { return pose.monotonic_ns > back_ns; };
    const std::vector<pose_t> frames = subscriber_->received().framePoses();
    const auto first = std::ranges::find_if(frames, is_after);
    const double pause_s = 1e-9 * static_cast<double>(first->monotonic_ns - back_ns);
    std::cout << name << ": the first frame is taken " << pause_s << " s later\n";
    EXPECT_LT(pause_s, kReopened_s);
    EXPECT_FALSE(daemon_->wait(milliseconds(0))) << daemon_->stderrText();
    const auto counted = [&](const Received& r) {
      return Received(r).counters()["camera.reopened"] == reopened + 1;
    };
    EXPECT_TRUE(subscriber_->waitFor(counted, milliseconds(10'000)));
    EXPECT_EQ(openDescriptors(daemon_->pid()), descriptors);
  }

  TemporaryDirectory directory_;
  std::optional<Subscriber> subscriber_;
  std::optional<Process> daemon_;
};

TEST_P(VividDaemonTest, Localizes) {
  ASSERT_NO_FATAL_FAILURE(startDaemon(GetParam()));
  stopDaemon();
  EXPECT_LT(worstError_m(), 0.02);
}
INSTANTIATE_TEST_SUITE_P(Formats, VividDaemonTest,
                         ::testing::Values(PixelFormat::kGrey, PixelFormat::kYuyv,
                                           PixelFormat::kNv12),
                         formatName);

using VividFaultTest = VividDaemonTest;

TEST_P(VividFaultTest, TheDaemonGoesOnInItsMap) {
  ASSERT_NO_FATAL_FAILURE(startDaemon(GetParam()));
  for (int i = 0; i < 3; ++i) {
    expectRecovery("streams fail", [&] { ASSERT_TRUE(vivid_.failStreams()); });
    expectRecovery("disconnected", [&] {
      ASSERT_TRUE(vivid_.disconnect());
      vivid_.stop();  // one of the two users
      ASSERT_TRUE(vivid_.play(scene_->encoded(GetParam())));
    });
    expectRecovery("unplugged", [&] {
      ASSERT_TRUE(vivid_.unplug());
      vivid_.stop();
      ASSERT_TRUE(vivid_.plugIn());
      const Status prepared = vivid_.prepare(GetParam());
      ASSERT_TRUE(prepared) << prepared.error().message;
      ASSERT_TRUE(vivid_.play(scene_->encoded(GetParam())));
    });
    if (HasFatalFailure()) return;
  }
  stopDaemon();
  EXPECT_LT(worstError_m(), 0.02) << "one world from beginning to end";
}
INSTANTIATE_TEST_SUITE_P(Formats, VividFaultTest, ::testing::Values(PixelFormat::kGrey),
                         formatName);

}  // namespace
}  // namespace waymark::testing
