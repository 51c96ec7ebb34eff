// The whole way with a camera that knows the truth: the simulator in waymarkd, LCM, subscribers in
// other processes. The rate is modest: what is tested is what arrives, not how fast.
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "io/maps/map_file.h"
#include "io/trajectory.h"
#include "slam/detection/marker_detection.h"
#include "tests/multicast.h"
#include "tests/process.h"
#include "tests/subscriber.h"
#include "tests/temporary_directory.h"
#include "tools/evaluation/evaluation.h"

namespace waymark::testing {
namespace {

using std::chrono::milliseconds;

constexpr int kPoses = 60;  // three seconds: the loop of the simulator ends and begins again

slam::Transform transformOf(const double (&q)[4], const double (&p)[3]) {
  return slam::Transform::fromQuaternion(Eigen::Quaterniond(q[0], q[1], q[2], q[3]),
                                         Eigen::Vector3d(p));
}

io::Trajectory trajectoryOf(const std::vector<pose_t>& poses) {
  io::Trajectory trajectory;
  for (const pose_t& pose : poses) {
    if (pose.source == pose_t::SOURCE_NONE) continue;
    trajectory.push_back({1000 * pose.utime, transformOf(pose.q_w_c, pose.p_w_c)});
  }
  return trajectory;
}

// The corners of every piece of the newest map.
std::vector<io::MarkerCorners> newestMap(const std::vector<map_t>& pieces) {
  std::vector<io::MarkerCorners> markers;
  std::set<int> seen;  // a map that stays as it is comes again
  for (const map_t& piece : pieces) {
    if (piece.revision != pieces.back().revision || !seen.insert(piece.piece).second) continue;
    for (const marker_t& marker : piece.markers) {
      io::MarkerCorners corners{marker.id, marker.size, slam::markerCorners(marker.size)};
      const slam::Transform T_w_m = transformOf(marker.q_w_m, marker.p_w_m);
      for (Eigen::Vector3d& corner : corners.corners) corner = T_w_m * corner;
      markers.push_back(corners);
    }
  }
  return markers;
}

// Runs waymarkd and `waymark echo` until there are enough poses.
class LiveDaemonTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!ensureMulticastRoute()) GTEST_SKIP() << "no multicast route, and none may be made";
    const std::string url = randomUrl();
    std::ofstream(directory_ / "waymarkd.toml")
        << "[camera]\nsource = 'sim:walls'\nrate_hz = 20\n"
           "[camera.simulator]\nloop_s = 2\ntruth_dir = 'truth'\n"
           "[slam]\ndictionary = 'ARUCO_MIP_36h12'\nmarker_size_m = 0.165\n"
           "[publish]\nchannel_prefix = 'TEST_'\nurl = '"
        << url << "'\n";
    const Subscriber subscriber(url, "TEST_");
    Process echo({WAYMARK_PROGRAM, "echo", "--tum", "--url", url, "--channel-prefix", "TEST_"},
                 directory_ / "echo.err", directory_ / "echo.tum");
    Process daemon({WAYMARKD, "--config", (directory_ / "waymarkd.toml").string()},
                   directory_ / "daemon.err");
    const auto enough = [](const Received& r) { return r.framePoses().size() >= kPoses; };
    ASSERT_TRUE(subscriber.waitFor(enough, milliseconds(300'000))) << daemon.stderrText();
    daemon.signal(SIGTERM);
    ASSERT_EQ(daemon.wait(milliseconds(60'000)), 0) << daemon.stderrText();

    // The very last message tells of every frame.
    const auto complete = [](const Received& r) {
      return r.counters()["published.poses"] == static_cast<std::int64_t>(r.framePoses().size());
    };
    EXPECT_TRUE(subscriber.waitFor(complete, milliseconds(10'000)));
    received_ = subscriber.received();
    // Echo is interrupted at once, and may not have come to the last messages yet.
    std::this_thread::sleep_for(milliseconds(500));
    echo.signal(SIGINT);
    EXPECT_EQ(echo.wait(milliseconds(60'000)), 0) << echo.stderrText();
    EXPECT_EQ(received_.undecodable, 0);
  }

  [[nodiscard]] io::Trajectory readTrajectory(const std::filesystem::path& path) const {
    const Result<io::Trajectory> trajectory = io::readTrajectory(path);
    if (!trajectory) {
      ADD_FAILURE() << trajectory.error().message;
      return {};
    }
    return *trajectory;
  }

  TemporaryDirectory directory_;
  Received received_;
};

TEST_F(LiveDaemonTest, PosesAndMapAreTheTruthAndEveryFrameIsAccountedFor) {
  // Every frame has a message or is counted, and the gaps in the sequence are those counted.
  std::map<std::string, std::int64_t> counters = received_.counters();
  std::int64_t dropped = 0;
  for (const auto& [name, value] : counters) {
    if (name.starts_with("dropped.")) dropped += value;
  }
  const std::int64_t captured = counters["camera.frames"] + counters["dropped.source_late"] +
                                counters["dropped.source_no_buffer"];
  const std::vector<pose_t> poses = received_.framePoses();
  EXPECT_EQ(static_cast<std::int64_t>(poses.size()) + dropped, captured);
  std::int64_t missing = captured - 1 - poses.back().sequence;  // after the last one
  std::int64_t expected = 0;
  for (const pose_t& pose : poses) {
    missing += pose.sequence - expected;
    expected = pose.sequence + 1;
  }
  EXPECT_EQ(missing, dropped);

  // WAYMARK_POSE, as `waymark echo` prints it, against the truth.
  const io::Trajectory truth = readTrajectory(directory_ / "truth" / "gt_traj.txt");
  const io::Trajectory echoed = readTrajectory(directory_ / "echo.tum");
  const io::Trajectory published = trajectoryOf(poses);
  ASSERT_EQ(echoed.size(), published.size());
  for (std::size_t i = 0; i < echoed.size(); ++i) {
    EXPECT_EQ(echoed[i].time_ns, published[i].time_ns);
    EXPECT_LT((echoed[i].T_w_c.p - published[i].T_w_c.p).norm(), 1e-8);
    EXPECT_LT(slam::rotationDistance(echoed[i].T_w_c.R, published[i].T_w_c.R), 1e-7);
  }
  EXPECT_GE(echoed.size() * 100, poses.size() * 95) << "most frames see markers";
  const auto errors = tools::compareTrajectories(truth, echoed, {.tolerance_ns = 1000});
  ASSERT_TRUE(errors) << errors.error().message;
  EXPECT_EQ(errors->matched, echoed.size()) << "stamps are those of the truth";
  EXPECT_LT(errors->ate_m.mean, 0.01);
  EXPECT_LT(errors->ate_m.max, 0.05);
  RecordProperty("ate_mm", std::to_string(1000.0 * errors->ate_m.mean));
  double path_m = 0.0;
  for (std::size_t i = 1; i < truth.size(); ++i) {
    path_m += (truth[i].T_w_c.p - truth[i - 1].T_w_c.p).norm();
  }
  EXPECT_GT(path_m, 0.1) << "a camera that stands still proves little";

  // POSE, the bot_core message, says the same.
  ASSERT_EQ(received_.bot_core_poses.size(), published.size());
  for (std::size_t i = 0; i < published.size(); ++i) {
    const bot_core::pose_t& pose = received_.bot_core_poses[i];
    EXPECT_EQ(1000 * pose.utime, published[i].time_ns);
    const slam::Transform T_w_b = transformOf(pose.orientation, pose.pos);
    EXPECT_EQ(T_w_b.p, published[i].T_w_c.p);
    EXPECT_LT(slam::rotationDistance(T_w_b.R, published[i].T_w_c.R), 1e-9);
  }

  // WAYMARK_MAP, against the layout that was rendered.
  ASSERT_FALSE(received_.maps.empty());
  const std::vector<io::MarkerCorners> map = newestMap(received_.maps);
  EXPECT_EQ(static_cast<int>(map.size()), received_.maps.back().marker_count);
  const auto layout = io::readMarkerCorners(directory_ / "truth" / "gt_map.json");
  ASSERT_TRUE(layout) << layout.error().message;
  const auto map_errors = tools::compareMaps(*layout, map);
  ASSERT_TRUE(map_errors) << map_errors.error().message;
  EXPECT_GE(map_errors->common, 4U);
  EXPECT_TRUE(map_errors->unknown.empty());
  EXPECT_LT(map_errors->ace_m.mean, 0.01);
}

}  // namespace
}  // namespace waymark::testing
