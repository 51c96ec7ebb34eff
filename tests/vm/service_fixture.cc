#include "tests/vm/service_fixture.h"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <fstream>

#include "base/clock.h"

namespace waymark::testing {

namespace fs = std::filesystem;

ProgramResult shell(const std::string& command) { return runProgram({"bash", "-c", command}); }

std::string trimmed(std::string text) {
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back())) != 0) {
    text.pop_back();
  }
  return text;
}

std::string property(const std::string& name, const std::string& unit) {
  return trimmed(runProgram({"systemctl", "show", "-P", name, unit}).out);
}

pid_t mainProcess(const std::string& unit) { return std::stoi(property("MainPID", unit)); }

std::string journal(const std::string& unit) {
  return runProgram({"journalctl", "--no-pager", "-o", "cat", "-u", unit, "_COMM=waymarkd"}).out;
}

std::size_t countOf(const std::string& what, const std::string& text) {
  std::size_t count = 0;
  for (std::size_t at = text.find(what); at != text.npos; at = text.find(what, at + 1)) ++count;
  return count;
}

void write(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file) << text;
}

std::string simulated(double rate_hz, const std::string& slam, const std::string& channels) {
  constexpr double kFrames = 10.0;  // rendered at the start, then shown round and round
  // All markers are in view always: the status does not depend on which frames a slow guest drops.
  return "[camera]\nsource = 'sim:sheet'\nrate_hz = " + std::to_string(rate_hz) +
         "\n[camera.simulator]\nwidth = 320\nheight = 240\nloop_s = " +
         std::to_string(kFrames / rate_hz) + "\n[publish]\nchannel_prefix = '" + channels +
         "_'\npose_channel = '" + channels +
         "_BODY'\n[slam]\ndictionary = 'ARUCO_MIP_36h12'\nmarker_size_m = 0.032\n" + slam;
}

std::string keepingItsMap() {
  return simulated(kRate_hz, std::string("map_in = '") + kMap + "'\nmap_out = '" + kMap + "'\n",
                   "TEST") +
         "[realtime]\ncapture_priority = 60\nslam_priority = 50\npublisher_priority = 40\n"
         "lock_memory = true\n";
}

std::optional<ProgramResult> ServiceTest::installed_;
bool ServiceTest::of_this_build_ = false;

void ServiceTest::SetUpTestSuite() {
  // Some computers forbid services to be started by packages; it is the guest that counts here.
  fs::remove("/usr/sbin/policy-rc.d");
  // The guest does without it, the unit does not.
  fs::remove("/etc/systemd/system/modprobe@.service");
  install();
}

void ServiceTest::install() {
  installed_ = dpkg("-i " WAYMARK_PACKAGES "/waymark_*.deb");
  const auto build_of = [](const std::string& program) {
    return shell("readelf -n " + program + " | grep 'Build ID'").out;
  };
  of_this_build_ = build_of("/usr/bin/waymarkd") == build_of(WAYMARKD);
}

void ServiceTest::SetUp() {
  ASSERT_EQ(installed_->exit_code, 0) << installed_->out << installed_->err;
  ASSERT_TRUE(of_this_build_) << "scripts/package has not been run since the last build";
}

ProgramResult ServiceTest::dpkg(const std::string& arguments) {
  return shell(
      "known=/root/dpkg; [[ -d $known ]] || { mkdir -p $known/{info,updates,triggers} && "
      "cp /var/lib/dpkg/status $known/; }; "
      "dpkg --admindir=$known --no-triggers --force-unsafe-io " +
      arguments);
}

void ServiceTest::ensureRunning() {
  if (property("ActiveState") != "active") {
    fs::remove_all("/var/lib/private/waymark");
    write(kConfiguration, keepingItsMap());
    const ProgramResult started = runProgram({"systemctl", "start", kUnit});
    ASSERT_EQ(started.exit_code, 0) << started.err << journal();
  }
  subscriber_.emplace(kUrl, "TEST_");
  ASSERT_TRUE(posesCome(3, *subscriber_)) << journal();
}

bool ServiceTest::posesCome(std::size_t count, const Subscriber& subscriber) {
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

}  // namespace waymark::testing
