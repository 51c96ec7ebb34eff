// `waymark echo` as scripts/demo uses it: from a simulated camera to the errors of what a
// subscriber got, every program in its own process.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/multicast.h"
#include "tests/process.h"
#include "tests/temporary_directory.h"

namespace waymark::testing {
namespace {

class EchoTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!ensureMulticastRoute()) GTEST_SKIP() << "no multicast route, and none may be made";
  }

  std::vector<std::string> daemonCommand(const std::string& of_slam = {},
                                         const std::string& of_publish = {}) const {
    const std::string configuration =
        "[camera]\nsource = \"sim:walls\"\nrate_hz = 30.0\n"
        "[camera.simulator]\nwidth = 320\nheight = 240\nloop_s = 2.0\ntruth_dir = \"truth\"\n"
        "[slam]\ndictionary = \"ARUCO_MIP_36h12\"\nmarker_size_m = 0.2\n" +
        of_slam + "[publish]\nurl = \"" + url_ + "\"\n" + of_publish;
    std::ofstream(file("waymarkd.toml")) << configuration;
    return {WAYMARKD, "--config", file("waymarkd.toml")};
  }
  std::string file(const char* name) const { return (directory_ / name).string(); }
  ProgramResult echo(std::vector<std::string> options) const {
    options.insert(options.begin(), {WAYMARK_PROGRAM, "echo", "--url", url_, "--count", "45"});
    return runProgram(options);
  }

  const TemporaryDirectory directory_;
  const std::string url_ = randomUrl();
};

TEST_F(EchoTest, WhatASubscriberGetsIsNearTheTruth) {
  Process daemon(daemonCommand(), file("log"));
  const ProgramResult echoed =
      echo({"--tum", "--stats", "--map", file("map.json"), "--picture", file("map.svg")});
  ASSERT_EQ(echoed.exit_code, 0) << echoed.err << daemon.stderrText();
  EXPECT_NE(echoed.out.find("# messages: 45"), std::string::npos) << echoed.out;
  EXPECT_NE(readFile(file("map.svg")).find("<svg"), std::string::npos);
  daemon.signal(SIGTERM);
  ASSERT_EQ(daemon.wait(std::chrono::milliseconds(5000)), 0) << daemon.stderrText();

  std::ofstream(file("estimate.tum")) << echoed.out;
  const ProgramResult evaluated = runProgram(
      {WAYMARK_PROGRAM, "eval", "--json", "--truth", file("truth/gt_traj.txt"), "--estimate",
       file("estimate.tum"), "--truth-map", file("truth/gt_map.json"), "--map", file("map.json")});
  ASSERT_EQ(evaluated.exit_code, 0) << evaluated.err;
  const nlohmann::json errors = nlohmann::json::parse(evaluated.out);
  EXPECT_GE(errors["matched"].get<int>(), 20);
  EXPECT_GE(errors["common_markers"].get<int>(), 3);
  // Wrong times, axes or maps would be off by decimetres.
  EXPECT_LT(errors["ate_m"]["rms"].get<double>(), 0.02);
  EXPECT_LT(errors["ace_m"]["rms"].get<double>(), 0.03);
}

TEST_F(EchoTest, WithoutADaemonItSaysSo) {
  const ProgramResult echoed =
      runProgram({WAYMARK_PROGRAM, "echo", "--url", url_, "--duration", "3"});
  EXPECT_EQ(echoed.exit_code, 3);
  EXPECT_NE(echoed.err.find("waymark echo: nothing on WAYMARK_POSE at " + url_ +
                            " for two seconds: is waymarkd running"),
            std::string::npos)
      << echoed.err;
}

TEST_F(EchoTest, PosesAsJson) {
  const Process daemon(daemonCommand(), file("log"));
  const ProgramResult echoed = echo({"--json"});
  ASSERT_EQ(echoed.exit_code, 0) << echoed.err << daemon.stderrText();
  std::istringstream lines(echoed.out);
  int poses = 0;
  for (std::string line; std::getline(lines, line);) {
    const nlohmann::json pose = nlohmann::json::parse(line);
    if (pose["status"] != "tracking") continue;
    ++poses;
    EXPECT_EQ(pose["p_w_c"].size(), 3U);
    EXPECT_EQ(pose["q_w_c"].size(), 4U);
    EXPECT_EQ(pose["covariance"].size(), 36U);
  }
  EXPECT_GT(poses, 20) << echoed.out;
}

// A marker is known worse in the world than by its own views: the larger number is the world's.
TEST_F(EchoTest, SigmasAreOfTheWorldAndOfTheMarkersInView) {
  const Process daemon(daemonCommand(), file("log"));
  const ProgramResult echoed = echo({"--sigma"});
  ASSERT_EQ(echoed.exit_code, 0) << echoed.err << daemon.stderrText();
  std::istringstream lines(echoed.out);
  int compared = 0;
  for (std::string line; std::getline(lines, line);) {
    const std::size_t begin = line.find("  world +- ");
    if (begin == std::string::npos) continue;
    double world_mm = 0.0;
    double world_deg = 0.0;
    double view_mm = 0.0;
    double view_deg = 0.0;
    ASSERT_EQ(std::sscanf(line.c_str() + begin, "  world +- %lf mm %lf deg  view +- %lf mm %lf deg",
                          &world_mm, &world_deg, &view_mm, &view_deg),
              4)
        << line;
    EXPECT_GT(view_mm, 0.0) << line;
    if (world_mm > 1.5 * view_mm) ++compared;
  }
  EXPECT_GT(compared, 0) << echoed.out;
}

// Where the map only serves to localize in, it never changes. Whoever comes late gets it all the
// same.
TEST_F(EchoTest, TheMapOfADaemonThatOnlyLocalizesReachesLateSubscribers) {
  const std::string map = file("own.json");
  {
    Process daemon(daemonCommand("map_out = \"" + map + "\"\n"), file("first.log"));
    const ProgramResult echoed = echo({"--quiet"});
    ASSERT_EQ(echoed.exit_code, 0) << echoed.err << daemon.stderrText();
    daemon.signal(SIGTERM);
    ASSERT_EQ(daemon.wait(std::chrono::milliseconds(20'000)), 0) << daemon.stderrText();
  }
  const Process daemon(
      daemonCommand("map_in = \"" + map + "\"\nlocalize_only = true\n", "map_interval_s = 0.3\n"),
      file("log"));
  for (const char* layout : {"early.json", "late.json"}) {
    const ProgramResult echoed = echo({"--quiet", "--map", file(layout)});
    ASSERT_EQ(echoed.exit_code, 0) << echoed.err << daemon.stderrText();
    const nlohmann::json read = nlohmann::json::parse(readFile(file(layout)), nullptr, false);
    EXPECT_FALSE(read.is_discarded() || read.empty()) << layout;
  }
  EXPECT_EQ(readFile(file("late.json")), readFile(file("early.json")));
  EXPECT_NE(readFile(file("late.json")).find("\"id\""), std::string::npos)
      << readFile(file("late.json"));
}

TEST_F(EchoTest, TheExampleForIntegratorsPrintsPoses) {
  const Process daemon(daemonCommand(), file("log"));
  const Process listener({POSE_LISTENER, url_}, file("listener.err"), file("listener.out"));
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  std::string said;
  while (said.find(" mm  ") == std::string::npos && std::chrono::steady_clock::now() < until) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    said = readFile(file("listener.out"));
  }
  EXPECT_NE(said.find(" m  +- "), std::string::npos)
      << said << readFile(file("listener.err")) << daemon.stderrText();
}

TEST_F(EchoTest, TimesCountFromTheFirstFrameAndLinesAreThinnedOut) {
  const Process daemon(daemonCommand(), file("log"));
  const ProgramResult echoed = echo({"--tum", "--from-start", "--interval", "0.3"});
  ASSERT_EQ(echoed.exit_code, 0) << echoed.err << daemon.stderrText();
  // The first frames may have no pose, so the first line need not be at 0; since 1970 it is not.
  const double first_s = std::stod(echoed.out);
  EXPECT_GE(first_s, 0.0) << echoed.out;
  EXPECT_LT(first_s, 1.5) << echoed.out;
  const auto lines = std::count(echoed.out.begin(), echoed.out.end(), '\n');
  EXPECT_GE(lines, 2);
  EXPECT_LE(lines, 15);  // of 45
}

}  // namespace
}  // namespace waymark::testing
