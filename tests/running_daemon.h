// waymarkd on a simulated camera, and `waymark ctl` to talk to it. Tests only.
#pragma once

#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/multicast.h"
#include "tests/process.h"
#include "tests/temporary_directory.h"

namespace waymark::testing {

class RunningDaemonTest : public ::testing::Test {
 protected:
  using Json = nlohmann::ordered_json;

  void SetUp() override {
    if (!ensureMulticastRoute()) GTEST_SKIP() << "no multicast route, and none may be made";
    std::filesystem::create_directory(directory_ / "maps");
  }

  // Pictures that are quickly made; the map is written whenever asked for.
  [[nodiscard]] std::string configuration(const std::string& slam = "",
                                          const std::string& more = "") const {
    return "[camera]\nsource = 'sim:walls'\nrate_hz = 100\n"
           "[camera.simulator]\nloop_s = 1\nwidth = 320\nheight = 240\n"
           "[publish]\nurl = '" +
           url_ +
           "'\nchannel_prefix = 'TEST_'\n"
           "[control]\nsocket = 'control.sock'\n"
           "[slam]\ndictionary = 'ARUCO_MIP_36h12'\nmarker_size_m = 0.165\n"
           "map_in = 'maps/map.json'\nmap_out = 'maps/map.json'\n" +
           slam + more;
  }
  void write(const std::string& text) const { std::ofstream(file_) << text; }

  // Starts it, and waits until it tracks. `wrapper`: a command in whose hands it runs.
  void start(const std::string& text, std::vector<std::string> wrapper = {}) {
    write(text);
    wrapper.insert(wrapper.end(), {WAYMARKD, "--config", file_.string()});
    daemon_ = std::make_unique<Process>(wrapper, directory_ / "stderr");
    ASSERT_TRUE(eventually([&] {
      const Json now = statusIfAny();
      return now.is_object() && now["status"] == "tracking" && now["map"]["markers"] > 0;
    })) << daemon_->stderrText();
  }
  [[nodiscard]] std::string said() const { return daemon_->stderrText(); }

  [[nodiscard]] ProgramResult ctl(const std::vector<std::string>& arguments) const {
    std::vector<std::string> command = {WAYMARK_PROGRAM, "ctl", "--socket",
                                        (directory_ / "control.sock").string()};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return runProgram(command);
  }
  // Null when there is no answer.
  [[nodiscard]] Json statusIfAny() const {
    const ProgramResult result = ctl({"status"});
    return result.exit_code == 0 ? Json::parse(result.out) : Json();
  }
  [[nodiscard]] Json status() const {
    Json now = statusIfAny();
    EXPECT_TRUE(now.is_object());
    return now;
  }
  [[nodiscard]] std::int64_t counter(const std::string& name) const {
    return status()["counters"].value(name, std::int64_t{-1});
  }

  // Counters are those of the last health message, up to a second old.
  [[nodiscard]] bool reaches(const std::string& name, std::int64_t value) const {
    return eventually([&] { return counter(name) >= value; }) && counter(name) == value;
  }

  [[nodiscard]] static bool eventually(const std::function<bool()>& holds) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!holds()) {
      if (std::chrono::steady_clock::now() > until) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    return true;
  }

  const TemporaryDirectory directory_;
  const std::filesystem::path file_ = directory_ / "waymarkd.toml";
  const std::filesystem::path map_ = directory_ / "maps/map.json";
  const std::string url_ = randomUrl();
  std::unique_ptr<Process> daemon_;
};

}  // namespace waymark::testing
