// `waymark ctl` and SIGHUP against a running waymarkd.
#include <algorithm>
#include <csignal>
#include <filesystem>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "daemon/system/testing_service_manager.h"
#include "io/calibrations/calibration_file.h"
#include "io/maps/map_file.h"
#include "tests/running_daemon.h"
#include "tests/subscriber.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

class DaemonControlTest : public RunningDaemonTest {
 protected:
  // Exit code 1, and one line that holds `reason`.
  void expectRejected(const std::vector<std::string>& arguments, const std::string& reason) {
    const ProgramResult result = ctl(arguments);
    EXPECT_EQ(result.exit_code, 1) << result.err;
    EXPECT_NE(result.err.find(reason), std::string::npos) << result.err;
    EXPECT_EQ(std::ranges::count(result.err, '\n'), 1) << result.err;
    EXPECT_EQ(result.out, "");
  }
  std::string printed(const std::vector<std::string>& arguments) {
    const ProgramResult result = ctl(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return result.out;
  }
};

TEST_F(DaemonControlTest, StatusIsTheHealthAndMore) {
  start(configuration());
  const Subscriber subscriber(url_, "TEST_");
  ASSERT_TRUE(
      subscriber.waitFor([](const Received& r) { return !r.healths.empty(); }, milliseconds(5000)));
  const Json now = status();
  EXPECT_EQ(now["camera"]["state"], "running");
  EXPECT_GT(now["frame_rate_hz"], 0.0);
  EXPECT_TRUE(now["recorder"].is_null());
  EXPECT_EQ(now["log_level"], "info");
  EXPECT_EQ(now["map"]["file"], map_.string());
  EXPECT_EQ(now["map"]["last_save_age_s"], nullptr);
  const auto published = subscriber.received().counters();
  EXPECT_EQ(now["counters"].size(), published.size());
  for (const auto& [name, value] : published) EXPECT_TRUE(now["counters"].contains(name)) << name;
  struct stat file {};
  ASSERT_EQ(::stat((directory_ / "control.sock").c_str(), &file), 0);
  EXPECT_EQ(file.st_mode & 0777, 0660U);
}

TEST_F(DaemonControlTest, AStatusForPeople) {
  start(configuration());
  const std::string table = printed({"status", "--table"});
  for (const char* line : {"status      tracking\n", "camera      running\n", "frames/s, ",
                           " markers, ", "recorder    not configured\n", "lost frames "}) {
    EXPECT_NE(table.find(line), std::string::npos) << line << "\n" << table;
  }
  EXPECT_TRUE(Json::parse(printed({"status", "--json"})).contains("counters"));
}

// Nobody says where: a daemon started by hand, and whoever wants to talk to it, agree.
TEST_F(DaemonControlTest, ADaemonStartedByHandIsFound) {
  const fs::path runtime = directory_ / "runtime";
  fs::create_directory(runtime);
  const std::string set = "XDG_RUNTIME_DIR=" + runtime.string();
  const auto asked = [&] { return runProgram({"env", set, WAYMARK_PROGRAM, "ctl", "status"}); };
  if (fs::exists("/run/waymark/control.sock")) GTEST_SKIP() << "a service runs here";
  const ProgramResult nobody = asked();
  EXPECT_EQ(nobody.exit_code, 2);
  EXPECT_NE(nobody.err.find("no daemon listens at /run/waymark/control.sock, " +
                            (runtime / "waymark/control.sock").string()),
            std::string::npos)
      << nobody.err;

  std::string text = configuration();
  const std::string socket = "[control]\nsocket = 'control.sock'\n";
  text.erase(text.find(socket), socket.size());
  write(text);
  const std::vector<std::string> command = {"env", set, WAYMARKD, "--config", file_.string()};
  daemon_ = std::make_unique<Process>(command, directory_ / "stderr");
  EXPECT_TRUE(eventually([&] { return asked().exit_code == 0; })) << said();
  // Another one runs without.
  Process second(command, directory_ / "second");
  EXPECT_TRUE(eventually([&] {
    return second.stderrText().find("no control socket: ") != std::string::npos;
  })) << second.stderrText();
  second.signal(SIGTERM);
  EXPECT_EQ(second.wait(milliseconds(20'000)), 0) << second.stderrText();
  EXPECT_EQ(asked().exit_code, 0) << "the first one goes on";
}

TEST_F(DaemonControlTest, TheLensInUseIsSaved) {
  start(configuration());
  const fs::path file = directory_ / "calib.yml";
  EXPECT_TRUE(printed({"save-calibration", file.string()})
                  .starts_with(file.string() + ": the lens as given, focal length "));
  const auto saved = io::readCalibration(file);
  ASSERT_TRUE(saved) << saved.error().message;
  EXPECT_EQ(saved->width, 320);
  EXPECT_EQ(saved->fx, status()["lens"]["fx"]);
  const ProgramResult again = ctl({"save-calibration", file.string()});
  EXPECT_EQ(again.exit_code, 2);
  EXPECT_EQ(again.err,
            "waymark ctl: " + file.string() + ": is there already; --force takes its place\n");
  (void)printed({"save-calibration", file.string(), "--force"});
}

// Without pieces: a camera that is among markers which the loaded map does not have yet would begin
// one, and come into the map by a joint.
TEST_F(DaemonControlTest, TheMapIsSavedLoadedAndReset) {
  start(configuration() + "[slam.pieces]\nbegin = false\n");
  EXPECT_TRUE(printed({"save-map"}).starts_with(map_.string() + ": saved "));
  const auto saved = io::readMap(map_);
  ASSERT_TRUE(saved) << saved.error().message;
  EXPECT_GT(status()["map"]["last_save_age_s"], 0.0);

  const std::int64_t frames = counter("slam.frames");
  const fs::path replaced = map_.string() + ".replaced";
  EXPECT_EQ(printed({"reset"}),
            "beginning a new map; the one before is in " + replaced.string() + "\n");
  EXPECT_TRUE(io::readMap(replaced));
  EXPECT_GE(counter("slam.frames"), frames) << "counters only grow";
  EXPECT_TRUE(eventually([&] { return status()["status"] == "tracking"; })) << "in the new map";

  EXPECT_TRUE(printed({"load-map"}).starts_with(map_.string() + ": going on with "));
  EXPECT_TRUE(eventually([&] { return counter("slam.relocalizations") > 0; })) << status();
  const fs::path copy = directory_ / "copy.json";
  fs::copy(map_, copy);
  EXPECT_TRUE(printed({"load-map", copy.string()}).starts_with(copy.string() + ": going on with"));
  expectRejected({"load-map", "/nowhere.json"}, "/nowhere.json: cannot be read: No such file");
  expectRejected({"load-map", file_.string()}, file_.string() + ":1:");
  EXPECT_TRUE(reaches("map.loads", 2));
  EXPECT_TRUE(reaches("map.load_failures", 2));

  EXPECT_TRUE(printed({"save-map"}).starts_with(map_.string() + ": "));
  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(milliseconds(20'000)), 0) << said();
  EXPECT_TRUE(io::readMap(map_));
  EXPECT_FALSE(fs::exists(directory_ / "control.sock"));
}

// As near to a power cut as a test comes: killed while it saves, again and again.
TEST_F(DaemonControlTest, KilledWhileItSavesItFindsAGoodMap) {
  std::mt19937 rng(3);
  for (int round = 0; round < 3; ++round) {
    start(configuration());
    if (round > 0) {
      EXPECT_NE(said().find("map.json: going on with "), std::string::npos) << said();
    }
    ASSERT_EQ(ctl({"save-map"}).exit_code, 0);
    std::thread saving([&] {
      while (ctl({"save-map"}).exit_code == 0) {
      }
    });
    std::this_thread::sleep_for(milliseconds(100 + rng() % 400));
    daemon_->signal(SIGKILL);
    saving.join();
    EXPECT_EQ(daemon_->wait(milliseconds(5000)), -1);
    EXPECT_TRUE(io::readMap(map_) || io::readMap(map_.string() + ".previous"));
  }
}

TEST_F(DaemonControlTest, RecordsWhenAsked) {
  start(configuration("", "[record]\ndirectory = 'logs'\nat_start = false\n"));
  const auto state = [&] { return status()["recorder"]["state"]; };
  EXPECT_EQ(state(), "off");
  EXPECT_EQ(printed({"record", "start"}), "");
  EXPECT_TRUE(eventually([&] { return state() == "recording"; }));
  EXPECT_TRUE(fs::exists(status()["recorder"]["file"].get<std::string>()));
  EXPECT_EQ(printed({"record", "stop"}), "");
  EXPECT_TRUE(eventually([&] { return state() == "off"; }));
}

TEST_F(DaemonControlTest, WhatItRejects) {
  start(configuration("localize_only = false\n"));
  expectRejected({"record", "start"}, "record.directory is not configured");
  EXPECT_EQ(ctl({"fly"}).exit_code, 2);
  EXPECT_EQ(ctl({"record", "up"}).exit_code, 2);
  EXPECT_EQ(ctl({"set-log-level", "loud"}).exit_code, 2);
  EXPECT_EQ(ctl({}).exit_code, 2);
  const ProgramResult nobody =
      runProgram({WAYMARK_PROGRAM, "ctl", "--socket", "/nowhere.sock", "status"});
  EXPECT_EQ(nobody.exit_code, 2);
  EXPECT_EQ(nobody.err, "waymark ctl: /nowhere.sock: no daemon listens there\n");

  // A second daemon with the same socket.
  const ProgramResult second = runProgram({WAYMARKD, "--config", file_.string()});
  EXPECT_EQ(second.exit_code, 2);
  EXPECT_NE(second.err.find("control.sock: another daemon listens on this control socket\n"),
            std::string::npos)
      << second.err;
  EXPECT_EQ(std::ranges::count(second.err, '\n'), 1) << second.err;
  EXPECT_EQ(ctl({"status"}).exit_code, 0) << "the first one goes on";
}

TEST_F(DaemonControlTest, LocalizeOnlyKeepsTheMap) {
  start(configuration());
  ASSERT_EQ(ctl({"save-map"}).exit_code, 0);
  daemon_->signal(SIGTERM);
  ASSERT_EQ(daemon_->wait(milliseconds(20'000)), 0);
  const std::string before = readFile(map_);
  std::string text = configuration("localize_only = true\n");
  text.erase(text.find("map_out"), text.find('\n', text.find("map_out")) - text.find("map_out"));
  start(text);
  expectRejected({"reset"}, "with slam.localize_only the map stays as it is");
  expectRejected({"save-map"}, "with slam.localize_only no map is written");
  EXPECT_EQ(printed({"load-map"}).find(map_.string()), 0U);
  EXPECT_TRUE(eventually([&] { return status()["status"] == "tracking"; }));
  EXPECT_EQ(readFile(map_), before);
}

TEST_F(DaemonControlTest, ReloadAppliesWhatItCanAndSaysWhatItCannot) {
  const daemon::testing::NotifySocket service_manager;
  ASSERT_TRUE(service_manager.listens());
  start(configuration());
  std::string fresh =
      configuration("map_save_interval_s = 7\n", "[log]\nlevel = 'debug'\n[queue]\ndepth = 9\n");
  fresh.replace(fresh.find("[publish]\n"), 10, "[publish]\ndetections = false\n");
  write(fresh);
  EXPECT_EQ(printed({"reload"}),
            "applied: log.level, publish.detections, slam.map_save_interval_s\n"
            "needs a restart: queue.depth\n");
  EXPECT_EQ(status()["log_level"], "debug");
  EXPECT_EQ(printed({"set-log-level", "error"}), "");
  EXPECT_EQ(status()["log_level"], "error");
  const Subscriber subscriber(url_, "TEST_");
  ASSERT_TRUE(subscriber.waitFor([](const Received& r) { return r.framePoses().size() > 20; },
                                 milliseconds(5000)));
  EXPECT_TRUE(subscriber.received().detections.empty());

  // By signal, and with a fault: nothing changes, and the journal has the place.
  write(fresh + "colour = 1\n");
  while (!service_manager.next(0).empty()) {
  }
  daemon_->signal(SIGHUP);
  std::string told;
  ASSERT_TRUE(eventually([&] {
    told += service_manager.next(100);
    return told.find("READY=1") != std::string::npos;
  }));
  EXPECT_NE(told.find("RELOADING=1\nMONOTONIC_USEC="), std::string::npos) << told;
  EXPECT_TRUE(eventually([&] { return said().find("not reloaded: ") != std::string::npos; }));
  EXPECT_NE(said().find("queue.colour: unknown key"), std::string::npos) << said();
  EXPECT_EQ(status()["log_level"], "error");
  EXPECT_TRUE(reaches("configuration.reloads", 1));
  EXPECT_TRUE(reaches("configuration.reload_failures", 1));
  expectRejected({"reload"}, "queue.colour: unknown key");
}

}  // namespace
}  // namespace waymark::testing
