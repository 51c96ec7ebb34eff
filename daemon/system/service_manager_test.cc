#include "daemon/system/service_manager.h"

#include <cstdlib>
#include <string>

#include <gtest/gtest.h>
#include <unistd.h>

#include "daemon/system/testing_service_manager.h"

namespace waymark::daemon {
namespace {

TEST(ServiceManager, IsToldWhatTheProtocolAsksFor) {
  const testing::NotifySocket socket;
  ASSERT_TRUE(socket.listens());
  const ServiceManager service{};
  service.ready();
  EXPECT_EQ(socket.next(1000), "READY=1");
  service.status("tracking");
  EXPECT_EQ(socket.next(1000), "STATUS=tracking");
  service.reloading();
  EXPECT_TRUE(socket.next(1000).starts_with("RELOADING=1\nMONOTONIC_USEC="));
  service.alive();
  EXPECT_EQ(socket.next(1000), "WATCHDOG=1");
  service.stopping();
  EXPECT_EQ(socket.next(1000), "STOPPING=1");
}

TEST(ServiceManager, WithoutOneNothingHappens) {
  const ServiceManager service{};
  service.ready();
  service.alive();
}

TEST(ServiceManager, TheWatchdogIsForTheProcessItNames) {
  unsetenv("WATCHDOG_USEC");
  EXPECT_EQ(ServiceManager::watchdogNs(), 0);
  setenv("WATCHDOG_USEC", "5000000", 1);
  setenv("WATCHDOG_PID", std::to_string(getpid()).c_str(), 1);
  EXPECT_EQ(ServiceManager::watchdogNs(), 5'000'000'000);
  setenv("WATCHDOG_PID", "1", 1);
  EXPECT_EQ(ServiceManager::watchdogNs(), 0);
  unsetenv("WATCHDOG_USEC");
  unsetenv("WATCHDOG_PID");
}

}  // namespace
}  // namespace waymark::daemon
