// A camera that comes later, two cameras, and the end of it all.
#include <filesystem>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/process.h"
#include "tests/subscriber.h"
#include "tests/vm/service_fixture.h"
#include "tests/vm/wall_clock_steps.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;

// Kinds of devices are known to the device policy only while the kernel knows them.
TEST_F(ServiceTest, ACameraMayComeAfterTheServiceAndItsTimesFollowTheWallClock) {
  ASSERT_EQ(runProgram({"systemctl", "stop", kUnit}).exit_code, 0);
  // Another program's tests may have left theirs.
  const ProgramResult none = runProgram({"modprobe", "-r", "-a", "vivid", "vimc"});
  ASSERT_EQ(none.exit_code, 0) << none.err;
  ASSERT_FALSE(fs::exists("/dev/video0"));
  write("/etc/waymark/calib.yml",
        "%YAML:1.0\n---\nimage_width: 320\nimage_height: 180\n"
        "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        "   data: [ 300., 0., 159.5, 0., 300., 89.5, 0., 0., 1. ]\n"
        "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n"
        "   data: [ 0., 0., 0., 0., 0. ]\n");
  write(kConfiguration,
        "[camera]\nsource = 'v4l2:/dev/video0'\ncalibration = 'calib.yml'\nformat = 'GREY'\n"
        "rate_hz = 5.0\n[slam]\ndictionary = '4X4_50'\nmarker_size_m = 0.1\n"
        "[publish]\nchannel_prefix = 'TEST_'\n");
  subscriber_.emplace(kUrl, "TEST_");
  ASSERT_EQ(runProgram({"systemctl", "start", kUnit}).exit_code, 0) << journal();
  const auto waiting = [](const Received& r) {
    return !r.healths.empty() && !r.healths.back().camera_reason.empty();
  };
  EXPECT_TRUE(subscriber_->waitFor(waiting, kPatience)) << journal();
  ASSERT_EQ(shell("modprobe vivid n_devs=1 node_types=0x1").exit_code, 0);
  const auto running = [](const Received& r) { return r.framePoses().size() > 5; };
  ASSERT_TRUE(subscriber_->waitFor(running, kPatience)) << journal();

  const std::vector<Stage> stages = stepBackAndForth(*subscriber_);
  const std::vector<pose_t> frames = framesSince(*subscriber_, stages.front().begin_ns);
  EXPECT_GE(frames.size(), 35U);  // some were on their way before
  expectNoneMissingUncounted(*subscriber_);
  expectTimesOf(stages, frames);
  ASSERT_EQ(runProgram({"systemctl", "stop", kUnit}).exit_code, 0);
  EXPECT_EQ(shell("rmmod vivid").exit_code, 0);
}

TEST_F(ServiceTest, TwoCamerasAreTwoServicesUntilAPurgeLeavesNothing) {
  for (const std::string name : {"front", "rear"}) {
    write("/etc/waymark/" + name + ".toml",
          simulated(2.0, "map_out = '/var/lib/waymark-" + name + "/map.json'\n",
                    name == "front" ? "FRONT" : "REAR"));
  }
  // The drop-in brings the route that is missing.
  write("/etc/systemd/system/waymarkd@.service.d/multicast-lo.conf",
        readFile("/usr/share/waymark/multicast-lo.conf"));
  ASSERT_EQ(runProgram({"systemctl", "daemon-reload"}).exit_code, 0);
  ASSERT_EQ(shell("ip route del 224.0.0.0/4 dev lo").exit_code, 0);
  ASSERT_EQ(
      runProgram({"systemctl", "enable", "--now", "waymarkd@front", "waymarkd@rear"}).exit_code, 0)
      << journal("waymarkd@front") << journal("waymarkd@rear");
  {
    const Subscriber front(kUrl, "FRONT_");
    const Subscriber rear(kUrl, "REAR_");
    EXPECT_TRUE(posesCome(5, front)) << journal("waymarkd@front");
    EXPECT_TRUE(posesCome(5, rear)) << journal("waymarkd@rear");
  }
  const pid_t front = mainProcess("waymarkd@front");
  const pid_t rear = mainProcess("waymarkd@rear");
  EXPECT_NE(front, rear);

  const ProgramResult removed = dpkg("-r waymark");
  ASSERT_EQ(removed.exit_code, 0) << removed.err;
  EXPECT_FALSE(fs::exists("/proc/" + std::to_string(front)));
  EXPECT_FALSE(fs::exists("/proc/" + std::to_string(rear)));
  EXPECT_TRUE(fs::exists("/var/lib/waymark-front/map.json")) << "stopped as it should be";
  EXPECT_TRUE(fs::exists("/var/lib/waymark-rear/map.json"));
  EXPECT_TRUE(fs::exists("/etc/waymark/front.toml"));

  const ProgramResult purged = dpkg("--purge waymark");
  ASSERT_EQ(purged.exit_code, 0) << purged.err;
  EXPECT_EQ(property("LoadState"), "not-found");
  // Drop-ins are their authors', and the guest's own units are called after Waymark, too.
  const ProgramResult left = shell(
      "find /etc /run /usr/bin /usr/lib/systemd /usr/lib/udev /usr/lib/sysusers.d "
      "/usr/share/waymark /usr/share/man/man8 /var/lib -xdev "
      "-path /var/lib/dpkg -prune -o -name '*waymark*' -print 2>/dev/null | "
      "grep -v -e waymark-command -e waymark-shell -e waymarkd@.service.d");
  EXPECT_EQ(left.out, "");
}

}  // namespace
}  // namespace waymark::testing
