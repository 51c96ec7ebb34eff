// From installation to poses.
#include <chrono>
#include <filesystem>
#include <string>
#include <thread>

#include <gtest/gtest.h>
#include <sched.h>

#include "tests/process.h"
#include "tests/vm/inside_call.h"
#include "tests/vm/service_fixture.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

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

}  // namespace
}  // namespace waymark::testing
