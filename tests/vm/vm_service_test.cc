// waymarkd as a service: installed from its package, started and watched by a real systemd,
// confined. What scripts/package has built must be there.
#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/syscall.h>

#include "base/clock.h"
#include "tests/process.h"
#include "tests/subscriber.h"
#include "tests/vm/inside_call.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

// The guest's processors are emulated, perhaps on a busy computer: all takes its time.
constexpr milliseconds kPatience(120'000);
constexpr const char* kUnit = "waymarkd.service";
constexpr const char* kConfiguration = "/etc/waymark/waymarkd.toml";
constexpr const char* kMap = "/var/lib/waymark/map.json";
constexpr double kStopped_s = 2.0;  // from `systemctl stop` to the end of the process

// --- Programs ------------------------------------------------------------------------------------

ProgramResult shell(const std::string& command) { return runProgram({"bash", "-c", command}); }

std::string trimmed(std::string text) {
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back())) != 0) {
    text.pop_back();
  }
  return text;
}

std::string property(const std::string& name, const std::string& unit = kUnit) {
  return trimmed(runProgram({"systemctl", "show", "-P", name, unit}).out);
}

pid_t mainProcess(const std::string& unit = kUnit) { return std::stoi(property("MainPID", unit)); }

// What the programs of the unit have written since it was first started.
std::string journal(const std::string& unit = kUnit) {
  return runProgram({"journalctl", "--no-pager", "-o", "cat", "-u", unit, "_COMM=waymarkd"}).out;
}

std::size_t countOf(const std::string& what, const std::string& text) {
  std::size_t count = 0;
  for (std::size_t at = text.find(what); at != text.npos; at = text.find(what, at + 1)) ++count;
  return count;
}

// --- Configurations ------------------------------------------------------------------------------

void write(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file) << text;
}

// A small simulated camera that always sees markers. What is tested is the service, not what it
// computes.
std::string simulated(double rate_hz, const std::string& slam, const std::string& channels) {
  constexpr double kFrames = 10.0;  // rendered at the start, then shown round and round
  return "[camera]\nsource = 'sim:ceiling'\nrate_hz = " + std::to_string(rate_hz) +
         "\n[camera.simulator]\nwidth = 320\nheight = 240\nloop_s = " +
         std::to_string(kFrames / rate_hz) + "\n[publish]\nchannel_prefix = '" + channels +
         "_'\npose_channel = '" + channels +
         "_BODY'\n[slam]\ndictionary = 'ARUCO_MIP_36h12'\nmarker_size_m = 0.123\n" + slam;
}

constexpr double kRate_hz = 5.0;

std::string keepingItsMap() {
  return simulated(kRate_hz, std::string("map_in = '") + kMap + "'\nmap_out = '" + kMap + "'\n",
                   "TEST") +
         "[realtime]\ncapture_priority = 60\nslam_priority = 50\npublisher_priority = 40\n"
         "lock_memory = true\n";
}

class ServiceTest : public ::testing::Test {
 protected:
  static constexpr const char* kUrl = "udpm://239.255.76.67:7667?ttl=0";

  static void SetUpTestSuite() {
    // Some computers forbid services to be started by packages; it is the guest that counts here.
    fs::remove("/usr/sbin/policy-rc.d");
    // The guest does without it, the unit does not.
    fs::remove("/etc/systemd/system/modprobe@.service");
    install();
  }

  // dpkg with what it knows of the installed packages, but not of their files: reading that takes
  // minutes in here, and tests/package/clean_root does it all. Other packages' triggers have
  // nothing to do.
  static ProgramResult dpkg(const std::string& arguments) {
    return shell(
        "known=/root/dpkg; [[ -d $known ]] || { mkdir -p $known/{info,updates,triggers} && "
        "cp /var/lib/dpkg/status $known/; }; "
        "dpkg --admindir=$known --no-triggers --force-unsafe-io " +
        arguments);
  }

  static void install() {
    installed_ = dpkg("-i " WAYMARK_PACKAGES "/waymark_*.deb");
    const auto build_of = [](const std::string& program) {
      return shell("readelf -n " + program + " | grep 'Build ID'").out;
    };
    of_this_build_ = build_of("/usr/bin/waymarkd") == build_of(WAYMARKD);
  }

  void SetUp() override {
    ASSERT_EQ(installed_->exit_code, 0) << installed_->out << installed_->err;
    ASSERT_TRUE(of_this_build_) << "scripts/package has not been run since the last build";
  }

  // Starts the service where it does not run, and waits for poses.
  void ensureRunning() {
    if (property("ActiveState") != "active") {
      fs::remove_all("/var/lib/private/waymark");
      write(kConfiguration, keepingItsMap());
      const ProgramResult started = runProgram({"systemctl", "start", kUnit});
      ASSERT_EQ(started.exit_code, 0) << started.err << journal();
    }
    subscriber_.emplace(kUrl, "TEST_");
    ASSERT_TRUE(posesCome(3, *subscriber_)) << journal();
  }

  // Poses of frames from now on.
  [[nodiscard]] static bool posesCome(std::size_t count, const Subscriber& subscriber) {
    const std::int64_t now_ns = monotonicNs();
    return subscriber.waitFor(
        [&](const Received& received) {
          const auto fresh = [&](const pose_t& pose) {
            return pose.source == pose_t::SOURCE_MARKERS && pose.monotonic_ns > now_ns;
          };
          return std::ranges::count_if(received.poses, fresh) >= static_cast<std::ptrdiff_t>(count);
        },
        kPatience);
  }

  static std::optional<ProgramResult> installed_;
  static bool of_this_build_;
  std::optional<Subscriber> subscriber_;
};
std::optional<ProgramResult> ServiceTest::installed_;
bool ServiceTest::of_this_build_ = false;

// --- From installation to poses ------------------------------------------------------------------

TEST_F(ServiceTest, InstallingStartsNothing) {
  EXPECT_EQ(trimmed(runProgram({"systemctl", "is-enabled", kUnit}).out), "disabled");
  EXPECT_EQ(property("ActiveState"), "inactive");
  EXPECT_EQ(trimmed(shell("stat -c %U:%G /etc/waymark").out), "root:root");
}

TEST_F(ServiceTest, WithoutAConfigurationItFailsWithOneLineAndIsNotTriedAgain) {
  ASSERT_FALSE(fs::exists(kConfiguration));
  EXPECT_NE(runProgram({"systemctl", "start", kUnit}).exit_code, 0);
  std::this_thread::sleep_for(milliseconds(3000));
  EXPECT_EQ(property("ActiveState"), "failed");
  EXPECT_EQ(property("ExecMainStatus"), "2");
  EXPECT_EQ(property("NRestarts"), "0");
  const std::string said = journal();
  EXPECT_EQ(countOf("\n", said), 1U) << said;
  EXPECT_NE(said.find(kConfiguration), said.npos) << said;
}

TEST_F(ServiceTest, EnabledItStartsAndIsReadyAndPublishes) {
  write(kConfiguration, keepingItsMap());
  const ProgramResult enabled = runProgram({"systemctl", "enable", "--now", kUnit});
  ASSERT_EQ(enabled.exit_code, 0) << enabled.err << journal();
  EXPECT_EQ(trimmed(runProgram({"systemctl", "is-enabled", kUnit}).out), "enabled");
  EXPECT_EQ(property("ActiveState"), "active");
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  EXPECT_EQ(property("StatusText"), "tracking");
  EXPECT_EQ(property("WatchdogUSec"), "10s");
  EXPECT_EQ(trimmed(shell("stat -c %U:%G /etc/waymark").out), "root:root") << "not the service's";
  EXPECT_EQ(trimmed(shell("stat -c %U:%G:%a /run/waymark").out), "waymarkd:waymark:750");
}

TEST_F(ServiceTest, ThreadsHaveTheirPrioritiesAndMemoryIsLocked) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  const pid_t process = mainProcess();
  const auto expectPriority = [&](const char* name, int priority) {
    const pid_t thread = threadNamed(process, name);
    ASSERT_GT(thread, 0) << name;
    sched_param parameters{};
    EXPECT_EQ(sched_getscheduler(thread), SCHED_FIFO) << name;
    EXPECT_EQ(sched_getparam(thread, &parameters), 0);
    EXPECT_EQ(parameters.sched_priority, priority) << name;
  };
  expectPriority("wm-capture", 60);
  expectPriority("wm-slam", 50);
  expectPriority("wm-publisher", 40);
  const std::string locked =
      shell("awk '/^VmLck/ { print ($2 > 0) }' /proc/" + std::to_string(process) + "/status").out;
  EXPECT_EQ(trimmed(locked), "1");
}

// As somebody who is in these groups only ("": in none); what `waymark ctl status` says.
ProgramResult statusAsMemberOf(const std::string& groups) {
  return shell("setpriv --reuid=nobody --regid=nogroup " +
               (groups.empty() ? std::string("--clear-groups") : "--groups=" + groups) +
               " waymark ctl status");
}

TEST_F(ServiceTest, ItIsReloadedAndItsGroupMayAskIt) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  const pid_t before = mainProcess();
  EXPECT_EQ(statusAsMemberOf("").exit_code, 2) << "its socket is not for everybody";
  const ProgramResult status = statusAsMemberOf("waymark");
  ASSERT_EQ(status.exit_code, 0) << status.err;
  EXPECT_NE(status.out.find("\"log_level\": \"info\""), status.out.npos) << status.out;

  write(kConfiguration, keepingItsMap() + "[log]\nlevel = 'debug'\n");
  EXPECT_EQ(runProgram({"systemctl", "reload", kUnit}).exit_code, 0);
  const auto until = std::chrono::steady_clock::now() + kPatience;
  std::string said;
  while (said.find("\"log_level\": \"debug\"") == said.npos &&
         std::chrono::steady_clock::now() < until) {
    std::this_thread::sleep_for(milliseconds(200));
    said = statusAsMemberOf("waymark").out;
  }
  EXPECT_NE(said.find("\"log_level\": \"debug\""), said.npos) << journal();
  EXPECT_EQ(mainProcess(), before) << "the same process";
  write(kConfiguration, keepingItsMap());
}

// --- What it may not do --------------------------------------------------------------------------

class Inside {
 public:
  explicit Inside(pid_t process) : call_(process) {}
  [[nodiscard]] InsideCall& operator*() { return call_; }
  [[nodiscard]] bool held() const { return call_.held(); }

  // 0 when it works, errno when it is rejected.
  int opening(const std::string& path, int flags) { return errorOf(call_.open(path, flags)); }
  int socket(int family, int type) { return errorOf(call_.socket(family, type)); }
  int calling(long number, std::array<std::uint64_t, 6> arguments = {}) {
    return errorOf(call_.call(number, arguments), false);
  }
  // Sends a datagram to the address, discard's port.
  int sendingTo(const char* address) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(9);
    inet_pton(AF_INET, address, &to.sin_addr);
    const std::optional<long> fd = call_.socket(AF_INET, SOCK_DGRAM);
    if (!fd || *fd < 0) return -1;
    const std::uint64_t there =
        call_.place(std::string(reinterpret_cast<const char*>(&to), sizeof to));
    const int error = errorOf(
        call_.call(SYS_sendto, {static_cast<std::uint64_t>(*fd), there, 4, 0, there, sizeof to}),
        false);
    call_.close(*fd);
    return error;
  }

 private:
  int errorOf(std::optional<long> answer, bool close = true) {
    if (!answer) return -1;
    if (*answer < 0) return static_cast<int>(-*answer);
    if (close) call_.close(*answer);
    return 0;
  }

  InsideCall call_;
};

TEST_F(ServiceTest, FromInsideNothingOpensThatIsNotItsOwn) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  write("/home/somebody/letter", "private\n");
  fs::permissions("/home/somebody/letter", fs::perms::all);
  fs::permissions("/dev/ttyS0", fs::perms::all);
  {
    Inside inside(mainProcess());
    ASSERT_TRUE(inside.held());
    // That this is a way to look at all:
    EXPECT_EQ(inside.opening(kConfiguration, O_RDONLY), 0);
    EXPECT_EQ(inside.opening("/var/lib/waymark/probe", O_WRONLY | O_CREAT), 0);
    EXPECT_EQ(inside.opening("/run/waymark/probe", O_WRONLY | O_CREAT), 0);
    EXPECT_EQ(inside.opening("/tmp/probe", O_WRONLY | O_CREAT), 0) << "its own /tmp";

    EXPECT_EQ(inside.opening("/etc/shadow", O_RDONLY), EACCES);
    EXPECT_EQ(inside.opening("/home/somebody/letter", O_RDONLY), EACCES);
    EXPECT_EQ(inside.opening("/etc/waymark/probe", O_WRONLY | O_CREAT), EACCES);
    EXPECT_EQ(inside.opening("/usr/bin/probe", O_WRONLY | O_CREAT), EROFS);
    EXPECT_EQ(inside.opening("/var/lib/probe", O_WRONLY | O_CREAT), EROFS);
    EXPECT_EQ(inside.opening("/dev/kmsg", O_RDONLY), EACCES);
    EXPECT_EQ(inside.opening("/dev/ttyS0", O_RDWR | O_NOCTTY), EPERM) << "not its kind of device";
    EXPECT_EQ(inside.opening("/proc/1/status", O_RDONLY), ENOENT) << "no other processes";
    EXPECT_EQ(inside.opening("/proc/sys/kernel/hostname", O_RDONLY), ENOENT);
  }
  EXPECT_FALSE(fs::exists("/tmp/probe"));
  EXPECT_TRUE(posesCome(3, *subscriber_)) << "it goes on as if nothing had been";
}

TEST_F(ServiceTest, FromInsideThereIsNoTcpAndNobodyToTalkTo) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  {
    Inside inside(mainProcess());
    ASSERT_TRUE(inside.held());
    EXPECT_EQ(inside.socket(AF_INET, SOCK_DGRAM), 0);
    EXPECT_EQ(inside.socket(AF_UNIX, SOCK_STREAM), 0);
    EXPECT_EQ(inside.socket(AF_NETLINK, SOCK_RAW), 0);
    EXPECT_EQ(inside.sendingTo("239.255.76.67"), 0);

    EXPECT_EQ(inside.socket(AF_INET, SOCK_STREAM), EACCES);
    EXPECT_EQ(inside.socket(AF_INET6, SOCK_STREAM), EACCES);
    EXPECT_EQ(inside.socket(AF_INET6, SOCK_DGRAM), EAFNOSUPPORT);
    EXPECT_EQ(inside.socket(AF_PACKET, SOCK_RAW), EAFNOSUPPORT);
    EXPECT_EQ(inside.sendingTo("127.0.0.1"), EPERM);
  }
  EXPECT_TRUE(posesCome(3, *subscriber_));
}

TEST_F(ServiceTest, FromInsideCallsOfTheMightyAreRejected) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  {
    Inside inside(mainProcess());
    ASSERT_TRUE(inside.held());
    EXPECT_EQ(inside.calling(SYS_getpid), 0);
    EXPECT_EQ(inside.calling(SYS_setuid, {0}), EPERM);
    EXPECT_EQ(inside.calling(SYS_unshare, {CLONE_NEWUSER}), EPERM);
    EXPECT_EQ(inside.calling(SYS_mount), EPERM);
    EXPECT_EQ(inside.calling(SYS_init_module), EPERM);
    EXPECT_EQ(inside.calling(SYS_ptrace), EPERM);
    EXPECT_EQ(inside.calling(SYS_bpf), EPERM);
    EXPECT_EQ(inside.calling(SYS_io_uring_setup, {1}), EACCES) << "by the daemon itself";
    EXPECT_EQ(inside.calling(SYS_kill, {1, SIGTERM}), EPERM);
    constexpr std::uint64_t kWritableCode = PROT_READ | PROT_WRITE | PROT_EXEC;
    constexpr std::uint64_t kOwnMemory = MAP_PRIVATE | MAP_ANONYMOUS;
    EXPECT_EQ(inside.calling(SYS_mmap, {0, 4096, kWritableCode, kOwnMemory, ~0ULL, 0}), EPERM);
  }
  EXPECT_TRUE(posesCome(3, *subscriber_));
}

// --- Clock and network ---------------------------------------------------------------------------

std::int64_t wallMinusMonotonic_us() {
  timespec wall{};
  clock_gettime(CLOCK_REALTIME, &wall);
  return 1'000'000LL * wall.tv_sec + wall.tv_nsec / 1000 - monotonicNs() / 1000;
}

void stepWallClock(std::int64_t by_s) {
  timespec wall{};
  clock_gettime(CLOCK_REALTIME, &wall);
  wall.tv_sec += by_s;
  ASSERT_EQ(clock_settime(CLOCK_REALTIME, &wall), 0);
}

// The wall clock as it was set.
struct Stage {
  std::int64_t begin_ns;
  std::int64_t wall_minus_monotonic_us;
};

// Sets the clock an hour forwards, an hour back, and right again, while frames come.
std::vector<Stage> stepBackAndForth(const Subscriber& subscriber) {
  std::vector<Stage> stages;
  for (const std::int64_t by_s : {0, 3600, -7200, 3600}) {
    stepWallClock(by_s);
    stages.push_back({monotonicNs(), wallMinusMonotonic_us()});
    const std::size_t frames = subscriber.received().framePoses().size();
    const auto enough = [&](const Received& r) { return r.framePoses().size() >= frames + 10; };
    EXPECT_TRUE(subscriber.waitFor(enough, kPatience)) << "after a step by " << by_s << " s";
  }
  return stages;
}

std::vector<pose_t> framesSince(const Subscriber& subscriber, std::int64_t begin_ns) {
  std::vector<pose_t> frames = subscriber.received().framePoses();
  std::erase_if(frames, [&](const pose_t& frame) { return frame.monotonic_ns < begin_ns; });
  return frames;
}

void expectEveryFrame(const std::vector<pose_t>& frames) {
  for (std::size_t i = 1; i < frames.size(); ++i) {
    EXPECT_EQ(frames[i].sequence, frames[i - 1].sequence + 1) << "a frame was lost";
    EXPECT_GT(frames[i].monotonic_ns, frames[i - 1].monotonic_ns);
    EXPECT_LT(frames[i].monotonic_ns - frames[i - 1].monotonic_ns, 1'000'000'000);
  }
}

// That no frame is missing but those that the daemon has counted.
void expectNoneMissingUncounted(const Subscriber& subscriber) {
  const auto later_health = [](const Received& r) {
    return !r.framePoses().empty() &&
           r.healths.back().monotonic_ns > r.framePoses().back().monotonic_ns;
  };
  EXPECT_TRUE(subscriber.waitFor(later_health, kPatience));
  const Received received = subscriber.received();
  const std::vector<pose_t> frames = received.framePoses();
  const std::int64_t missing = frames.back().sequence - frames.front().sequence + 1 -
                               static_cast<std::int64_t>(frames.size());
  std::int64_t counted = 0;
  for (const auto& [name, value] : received.counters()) {
    if (name.starts_with("dropped.")) counted += value;
  }
  std::cout << missing << " of " << frames.size() << " frames missing, " << counted << " counted\n";
  EXPECT_LE(missing, counted);
  EXPECT_LT(missing, static_cast<std::int64_t>(frames.size()) / 4);
}

// That each frame's two times are as far apart as the clocks were then.
void expectTimesOf(const std::vector<Stage>& stages, const std::vector<pose_t>& frames) {
  // A frame that is under way when the clock is set may have either time.
  constexpr std::int64_t kUnderWay_ns = 500'000'000;
  std::size_t compared = 0;
  for (const pose_t& frame : frames) {
    const auto next = std::ranges::find_if(
        stages, [&](const Stage& stage) { return stage.begin_ns > frame.monotonic_ns; });
    const Stage& stage = *std::prev(next);
    if (frame.monotonic_ns < stage.begin_ns + kUnderWay_ns) continue;
    if (next != stages.end() && frame.monotonic_ns > next->begin_ns - kUnderWay_ns) continue;
    const std::int64_t wall_minus_monotonic_us = frame.utime - frame.monotonic_ns / 1000;
    ASSERT_LT(std::abs(wall_minus_monotonic_us - stage.wall_minus_monotonic_us), 50'000)
        << "of frame " << frame.sequence;
    ++compared;
  }
  EXPECT_GE(compared, 5U);
}

TEST_F(ServiceTest, PosesComeThroughStepsOfTheWallClock) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  const std::string process = property("MainPID");
  const std::vector<Stage> stages = stepBackAndForth(*subscriber_);
  EXPECT_EQ(property("MainPID"), process);
  EXPECT_EQ(property("NRestarts"), "0");
  const std::vector<pose_t> frames = framesSince(*subscriber_, stages.front().begin_ns);
  EXPECT_GE(frames.size(), 35U);  // some were on their way before
  expectEveryFrame(frames);
  for (const pose_t& frame : frames) EXPECT_EQ(frame.status, pose_t::STATUS_TRACKING);
}

TEST_F(ServiceTest, TheMulticastRouteMayGoAndComeBack) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  const std::string process = property("MainPID");
  ASSERT_EQ(shell("ip route del 224.0.0.0/4 dev lo").exit_code, 0);
  std::this_thread::sleep_for(milliseconds(2000));
  const std::size_t before = subscriber_->received().poses.size();
  std::this_thread::sleep_for(milliseconds(2000));
  EXPECT_EQ(subscriber_->received().poses.size(), before) << "there is no way for them";
  ASSERT_EQ(shell("ip route add 224.0.0.0/4 dev lo").exit_code, 0);
  EXPECT_TRUE(posesCome(10, *subscriber_)) << journal();
  EXPECT_EQ(property("MainPID"), process);
  const std::string said = journal();
  EXPECT_EQ(countOf("there is no multicast route any more", said), 1U) << said;
  EXPECT_EQ(countOf("publishing to " + std::string(kUrl) + " again", said), 1U) << said;
}

// The unit's filter of addresses does not mind which way multicast goes.
TEST_F(ServiceTest, MulticastMayGoOverAnotherInterface) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  ASSERT_EQ(shell("modprobe dummy numdummies=0 && ip link add robot type dummy && "
                  "ip address add 10.77.0.1/24 dev robot && ip link set robot up multicast on && "
                  "ip route replace 224.0.0.0/4 dev robot")
                .exit_code,
            0);
  {
    const Subscriber there(kUrl, "TEST_");  // listens where the route leads now
    EXPECT_TRUE(posesCome(5, there)) << journal();
  }
  ASSERT_EQ(shell("ip route replace 224.0.0.0/4 dev lo && ip link del robot").exit_code, 0);
  EXPECT_TRUE(posesCome(5, *subscriber_)) << journal();
}

// --- Ends and beginnings -------------------------------------------------------------------------

// Stops the service, which saves its map, and returns how long that took.
double stop_s() {
  fs::remove(kMap);
  EXPECT_EQ(runProgram({"systemctl", "stop", kUnit}).exit_code, 0);
  EXPECT_EQ(property("Result"), "success");
  EXPECT_TRUE(fs::exists(kMap)) << journal();
  const double stopped_s =
      1e-6 * static_cast<double>(std::stoll(property("InactiveEnterTimestampMonotonic")) -
                                 std::stoll(property("ActiveExitTimestampMonotonic")));
  std::cout << "stopped within " << stopped_s << " s\n";
  return stopped_s;
}

TEST_F(ServiceTest, TheWatchdogRestartsItWhenTheSlamLoopHangs) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  const std::string process = property("MainPID");
  const std::string restarts = property("NRestarts");
  std::string result;
  {
    StoppedThread slam(threadNamed(std::stoi(process), "wm-slam"));
    ASSERT_TRUE(slam.held());
    const std::int64_t begin_ns = monotonicNs();
    const auto over = [&] { return monotonicNs() - begin_ns > 1'000'000LL * kPatience.count(); };
    while (property("NRestarts") == restarts && !over()) {
      slam.takeNote();
      if (result.empty() || result == "success") result = property("Result");
    }
    std::cout << "restarted " << 1e-9 * static_cast<double>(monotonicNs() - begin_ns)
              << " s after the SLAM loop was stopped\n";
  }
  EXPECT_EQ(property("NRestarts"), std::to_string(std::stoi(restarts) + 1));
  EXPECT_EQ(result, "watchdog");
  EXPECT_TRUE(posesCome(3, *subscriber_)) << journal();
  EXPECT_NE(property("MainPID"), process);
  EXPECT_EQ(countOf("the SLAM loop hangs", journal()), 1U);
}

double nearest_m(const pose_t& pose, const std::vector<pose_t>& others) {
  double nearest = 1e9;
  for (const pose_t& other : others) {
    nearest =
        std::min(nearest, std::hypot(pose.p_w_c[0] - other.p_w_c[0], pose.p_w_c[1] - other.p_w_c[1],
                                     pose.p_w_c[2] - other.p_w_c[2]));
  }
  return nearest;
}

std::vector<pose_t> localized(const Subscriber& subscriber) {
  std::vector<pose_t> poses = subscriber.received().poses;
  std::erase_if(poses, [](const pose_t& pose) { return pose.source != pose_t::SOURCE_MARKERS; });
  return poses;
}

TEST_F(ServiceTest, StoppedItSavesItsMapAndStartedAgainItIsThere) {
  // An emulated processor on a busy computer may take longer now and then, but not always.
  constexpr int kAttempts = 3;
  std::vector<pose_t> before;
  double stopped_s = kStopped_s;
  for (int attempt = 0; attempt < kAttempts && stopped_s >= kStopped_s; ++attempt) {
    ASSERT_NO_FATAL_FAILURE(ensureRunning());
    ASSERT_TRUE(posesCome(20, *subscriber_));  // twice round
    before = localized(*subscriber_);
    stopped_s = stop_s();
  }
  EXPECT_LT(stopped_s, kStopped_s);

  // Without making a map of its own it can only be somewhere in that one.
  write(
      kConfiguration,
      simulated(kRate_hz, std::string("map_in = '") + kMap + "'\nlocalize_only = true\n", "TEST"));
  subscriber_.emplace(kUrl, "TEST_");
  ASSERT_EQ(runProgram({"systemctl", "start", kUnit}).exit_code, 0) << journal();
  ASSERT_TRUE(posesCome(10, *subscriber_)) << journal();
  for (const pose_t& pose : localized(*subscriber_)) {
    EXPECT_LT(nearest_m(pose, before), 0.02) << "frame " << pose.sequence;
  }
  EXPECT_EQ(runProgram({"systemctl", "stop", kUnit}).exit_code, 0);
  EXPECT_EQ(property("Result"), "success");
}

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
