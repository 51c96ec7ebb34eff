// What goes wrong around a running waymarkd: poses keep coming, and each fault is counted.
#include <array>
#include <atomic>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include "base/unique_fd.h"
#include "daemon/control/testing_client.h"
#include "io/maps/map_file.h"
#include "tests/running_daemon.h"
#include "tests/subscriber.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

class DaemonFaultsTest : public RunningDaemonTest {
 protected:
  // Frames go on being captured, located and published.
  void expectPosesGoOn() {
    const std::int64_t before = counter("published.poses");
    EXPECT_TRUE(eventually([&] { return counter("published.poses") > before + 100; }));
  }
  // Every frame that came is a pose that was sent, or counted as lost before it came so far. To be
  // asked when the daemon has stopped.
  static void expectAllAccountedFor(std::map<std::string, std::int64_t> counters) {
    EXPECT_EQ(counters["camera.frames"], counters["published.poses"] + counters["dropped.queue"] +
                                             counters["dropped.publisher"] +
                                             counters["dropped.unsent"]);
  }
};

TEST_F(DaemonFaultsTest, AStoppedSubscriberStopsNobodyElse) {
  start(configuration());
  Process stopped({WAYMARK_PROGRAM, "echo", "--url", url_, "--channel-prefix", "TEST_"},
                  directory_ / "echo.err", directory_ / "echo.out");
  ASSERT_TRUE(eventually([&] { return !readFile(directory_ / "echo.out").empty(); }));
  stopped.signal(SIGSTOP);
  const Subscriber subscriber(url_, "TEST_");
  expectPosesGoOn();
  EXPECT_TRUE(subscriber.waitFor([](const Received& r) { return r.framePoses().size() > 50; },
                                 milliseconds(5000)));
  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(milliseconds(20'000)), 0) << said();
  ASSERT_TRUE(subscriber.waitFor(
      [](const Received& r) { return r.healths.size() > 1 && r.healths.back().uptime_ns > 0; },
      milliseconds(2000)));
  EXPECT_EQ(subscriber.received().counters()["dropped.publisher"], 0);
  EXPECT_EQ(subscriber.received().counters()["dropped.unsent"], 0);
}

// Everything that logs goes on: recorder, publisher, camera, housekeeping. Before, a log of some
// lines more than the pipe holds stopped one after the other.
TEST_F(DaemonFaultsTest, ALogThatNobodyReadsStopsNobody) {
  const fs::path log = directory_ / "stderr";
  ASSERT_EQ(::mkfifo(log.c_str(), 0600), 0);
  const UniqueFd pipe(::open(log.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
  ASSERT_EQ(::fcntl(pipe.get(), F_SETPIPE_SZ, 4096), 4096);
  write(configuration("", "[record]\ndirectory = 'recordings'\nkeep_free_mib = 0\n"));
  daemon_ = std::make_unique<Process>(
      std::vector<std::string>{WAYMARKD, "--config", file_.string()}, log);
  ASSERT_TRUE(eventually([&] {
    const Json now = statusIfAny();
    return now.is_object() && now["status"] == "tracking";
  }));
  const daemon::testing::TestClient client(directory_ / "control.sock");
  const auto answered = [&](const std::string& request) {
    client.send(request + "\n");
    std::string answer;
    return eventually([&] { return (answer += client.received()).ends_with("\n"); });
  };
  for (int i = 0; i < 80; ++i) {
    ASSERT_TRUE(answered(R"({"command":"record","action":"stop"})")) << i;
    ASSERT_TRUE(answered(R"({"command":"record","action":"start"})")) << i;
    ASSERT_TRUE(answered(R"({"command":"reload"})")) << i;
  }
  EXPECT_TRUE(eventually([&] { return status()["recorder"]["state"] == "recording"; }));
  expectPosesGoOn();
  EXPECT_EQ(counter("dropped.publisher"), 0);

  std::string text;
  const auto told = [&] {
    std::array<char, 4096> bytes{};
    for (ssize_t count = 0; (count = ::read(pipe.get(), bytes.data(), bytes.size())) > 0;) {
      text.append(bytes.data(), static_cast<std::size_t>(count));
    }
    return text.find("waymarkd: stopped after ") != text.npos;
  };
  daemon_->signal(SIGTERM);
  EXPECT_TRUE(eventually(told)) << "what waited is there, to the last line: " << text;
  EXPECT_EQ(daemon_->wait(milliseconds(20'000)), 0);
}

// Runs a command in the network of a process, in a thread that is then gone.
int runInNetworkOf(pid_t pid, const std::string& command) {
  int outcome = -1;
  std::thread([&] {
    const UniqueFd network(
        ::open(("/proc/" + std::to_string(pid) + "/ns/net").c_str(), O_RDONLY | O_CLOEXEC));
    if (network && setns(network.get(), CLONE_NEWNET) == 0) outcome = std::system(command.c_str());
  }).join();
  return outcome;
}

TEST_F(DaemonFaultsTest, TheRouteGoesAndComesBack) {
  if (std::system("unshare -n true 2> /dev/null") != 0) GTEST_SKIP() << "no network of one's own";
  const std::string script =
      "ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo && "
      "exec \"$0\" \"$@\"";
  start(configuration(), {"unshare", "-n", "sh", "-c", script});
  expectPosesGoOn();
  const std::int64_t localized = counter("slam.localized");
  ASSERT_EQ(runInNetworkOf(daemon_->pid(), "ip route del 224.0.0.0/4 dev lo"), 0);
  EXPECT_TRUE(eventually([&] { return counter("dropped.unsent") > 100; })) << status().dump(1);
  const Json counters = status()["counters"];
  EXPECT_GT(counters["unsent.link_down"], counters["dropped.unsent"]) << "other messages, too";
  EXPECT_GT(counter("slam.localized"), localized) << "it computes on";
  ASSERT_EQ(runInNetworkOf(daemon_->pid(), "ip route add 224.0.0.0/4 dev lo"), 0);
  expectPosesGoOn();
  EXPECT_NE(said().find("publishing to " + url_ + " again"), std::string::npos) << said();
}

TEST_F(DaemonFaultsTest, ADirectoryThatCannotBeWrittenToIsCountedAndTriedAgain) {
  const std::string maps = (directory_ / "maps").string();
  // Root may write anywhere, but not to what is mounted read-only.
  if (::unshare(CLONE_NEWNS) != 0 || ::mount("", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
      ::mount("tmpfs", maps.c_str(), "tmpfs", 0, nullptr) != 0) {
    GTEST_SKIP() << "no mounts of one's own";
  }
  start(configuration("map_save_interval_s = 1\n"));
  ASSERT_EQ(ctl({"save-map"}).exit_code, 0);
  ASSERT_EQ(::mount("", maps.c_str(), nullptr, MS_REMOUNT | MS_RDONLY, nullptr), 0);
  const std::string before = readFile(map_);
  ASSERT_EQ(ctl({"reset"}).exit_code, 0);  // a change
  EXPECT_TRUE(eventually([&] { return counter("map.save_failures") >= 2; }));
  const std::string last = status()["map"]["last_save"];
  EXPECT_NE(last.find("map.json: cannot be written: Read-only file system"), std::string::npos);
  const ProgramResult asked = ctl({"save-map"});
  EXPECT_EQ(asked.exit_code, 1);
  EXPECT_NE(asked.err.find("Read-only file system"), std::string::npos) << asked.err;
  expectPosesGoOn();
  EXPECT_EQ(readFile(map_), before);

  const std::int64_t saves = counter("map.saves");
  ASSERT_EQ(::mount("", maps.c_str(), nullptr, MS_REMOUNT, nullptr), 0);
  EXPECT_TRUE(eventually([&] { return counter("map.saves") > saves; })) << "by itself";
  EXPECT_NE(readFile(map_), before);
  EXPECT_TRUE(io::readMap(map_));
  EXPECT_EQ(readFile(map_.string() + ".previous").find("{\"format\""), 0U);
  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(milliseconds(20'000)), 0) << said();
  ::umount2(maps.c_str(), MNT_DETACH);
}

// As a disk comes up that was not unmounted: poses come, and it is counted that maps cannot be
// saved.
TEST_F(DaemonFaultsTest, AReadOnlyDiskAtTheStartCostsNoPoses) {
  const std::string maps = (directory_ / "maps").string();
  if (::unshare(CLONE_NEWNS) != 0 || ::mount("", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
      ::mount("tmpfs", maps.c_str(), "tmpfs", MS_RDONLY, nullptr) != 0) {
    GTEST_SKIP() << "no mounts of one's own";
  }
  start(configuration());
  EXPECT_NE(said().find("Read-only file system; the map will be saved when it can be"),
            std::string::npos)
      << said();
  EXPECT_GE(counter("map.save_failures"), 1);
  expectPosesGoOn();
  const ProgramResult check = runProgram({WAYMARKD, "--check", "--config", file_.string()});
  EXPECT_EQ(check.exit_code, 2) << "whoever asks is told";
  EXPECT_NE(check.err.find("Read-only file system"), std::string::npos) << check.err;

  ASSERT_EQ(::mount("", maps.c_str(), nullptr, MS_REMOUNT, nullptr), 0);
  EXPECT_EQ(ctl({"save-map"}).exit_code, 0) << "when it is better";
  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(milliseconds(20'000)), 0) << said();
  ::umount2(maps.c_str(), MNT_DETACH);
}

// One of a hundred that mean no good.
class HostileClient {
 public:
  HostileClient(fs::path socket, unsigned seed, const std::atomic<bool>& stop)
      : path_(std::move(socket)), rng_(seed), stop_(stop) {}

  void run() {
    while (!stop_) {
      const UniqueFd socket(::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
      sockaddr_un address{};
      address.sun_family = AF_UNIX;
      std::memcpy(address.sun_path, path_.c_str(), path_.native().size());
      if (::connect(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) ==
          0) {
        misbehave(socket.get());
      }
      std::this_thread::sleep_for(milliseconds(rng_() % 20));
    }
  }

 private:
  void misbehave(int socket) {
    const auto send = [&](const std::string& text) {
      (void)::send(socket, text.data(), text.size(), MSG_NOSIGNAL);
    };
    switch (rng_() % 7) {
      case 0:  // comes and goes
        return;
      case 1:
        return hold(1000);
      case 2:
        send("{\"command\":\"sta");
        return hold(500);
      case 3:
        send(garbage(300));
        return hold(100);
      case 4:
        for (int i = 0; i < 50 && !stop_; ++i) send(std::string(100'000, 'x'));
        return;
      case 5:  // asks, and never listens
        for (int i = 0; i < 500 && !stop_; ++i) send("{\"command\":\"status\"}\n");
        return hold(1000);
      default:
        for (int i = 0; i < 100 && !stop_; ++i) send("{\"command\":\"fly\"}\n[[[[\n\n");
        return hold(200);
    }
  }
  std::string garbage(std::size_t size) {
    std::string text(size, ' ');
    for (char& c : text) c = static_cast<char>(rng_() % 256);
    return text;
  }
  void hold(unsigned max_ms) {
    const auto until = std::chrono::steady_clock::now() + milliseconds(rng_() % max_ms);
    while (!stop_ && std::chrono::steady_clock::now() < until) {
      std::this_thread::sleep_for(milliseconds(5));
    }
  }

  const fs::path path_;
  std::mt19937 rng_;
  const std::atomic<bool>& stop_;
};

TEST_F(DaemonFaultsTest, AHundredHostileClients) {
  start(configuration());
  const Subscriber subscriber(url_, "TEST_");
  std::atomic<bool> stop{false};
  std::vector<std::thread> clients;
  for (unsigned i = 0; i < 100; ++i) {
    clients.emplace_back([&, i] { HostileClient(directory_ / "control.sock", i, stop).run(); });
  }
  // Who means well gets an answer, or is told to come again.
  int answered = 0;
  for (int i = 0; i < 10; ++i) {
    const ProgramResult result = ctl({"--timeout", "10", "status"});
    answered += result.exit_code == 0 ? 1 : 0;
    EXPECT_NE(result.exit_code, -1) << "killed";
    EXPECT_EQ(result.exit_code == 0, result.err.empty());
  }
  EXPECT_GE(answered, 5);
  stop = true;
  for (std::thread& client : clients) client.join();
  EXPECT_TRUE(eventually([&] { return statusIfAny().is_object(); }));
  expectPosesGoOn();
  EXPECT_GT(counter("control.bad_requests"), 0);
  EXPECT_GT(counter("control.dropped_clients"), 0);

  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(milliseconds(20'000)), 0) << said();
  std::this_thread::sleep_for(milliseconds(100));
  std::map<std::string, std::int64_t> counters = subscriber.received().counters();
  expectAllAccountedFor(counters);
  EXPECT_EQ(counters["dropped.publisher"], 0) << "none is lost behind the SLAM";
  EXPECT_EQ(counters["dropped.unsent"], 0);
}

}  // namespace
}  // namespace waymark::testing
