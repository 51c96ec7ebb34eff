#include "daemon/system/housekeeper.h"

#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include <gtest/gtest.h>
#include <sys/eventfd.h>

#include "base/clock.h"
#include "daemon/frames/stage_clock.h"
#include "daemon/system/testing_service_manager.h"
#include <waymark/pose_t.hpp>

namespace waymark::daemon {
namespace {

using std::chrono::milliseconds;

class HousekeeperTest : public ::testing::Test {
 protected:
  void make(std::int64_t watchdog_ns) {
    housekeeper_ = std::make_unique<Housekeeper>(
        frames_, slam_, health_, service_, log_,
        Housekeeper::Options{
            .tick = milliseconds(5), .rest = milliseconds(2), .watchdog_ns = watchdog_ns});
  }
  void start(std::int64_t watchdog_ns) {
    make(watchdog_ns);
    run();
  }
  void run() {
    thread_ = std::thread([this] { housekeeper_->run(); });
  }
  void TearDown() override {
    if (!thread_.joinable()) return;
    housekeeper_->requestStop();
    thread_.join();
  }
  // Whether such a message comes within the time.
  [[nodiscard]] bool reported(const std::string& message, milliseconds within) const {
    const auto until = std::chrono::steady_clock::now() + within;
    while (std::chrono::steady_clock::now() < until) {
      if (socket_.next(20) == message) return true;
    }
    return false;
  }

  const testing::NotifySocket socket_;
  FrameQueue frames_{2};
  SlamOutput slam_;
  TripleBuffer<health_t> health_;
  const ServiceManager service_{};
  const Log log_{LogLevel::kError, false};
  std::unique_ptr<Housekeeper> housekeeper_;
  std::thread thread_;
};

TEST_F(HousekeeperTest, FeedsTheWatchdogWhileTheSlamLoopComesRound) {
  start(400'000'000);
  std::thread slam([this] {
    while (!frames_.finished()) {
      (void)frames_.pop();
      slam_.alive_ns.store(monotonicNs());
    }
  });
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(reported("WATCHDOG=1", milliseconds(2000))) << i;
  frames_.close();
  slam.join();
}

TEST_F(HousekeeperTest, AHangingSlamLoopStarvesTheWatchdog) {
  slam_.alive_ns.store(monotonicNs() - 1'000'000'000);
  start(400'000'000);
  EXPECT_FALSE(reported("WATCHDOG=1", milliseconds(300)));
}

// The watchdog is much shorter than the frame.
TEST_F(HousekeeperTest, ASlowFrameThatGetsOnIsNoHang) {
  StageClock clock(&slam_.alive_ns);
  slam_.frame_began_ns.store(monotonicNs());
  start(200'000'000);
  clock.beginFrame();
  clock.begin(slam::Stage::kDetect);
  std::atomic<bool> done{false};
  std::thread slam([&] {
    while (!done) {
      std::this_thread::sleep_for(milliseconds(5));
      clock.advance();
    }
  });
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(reported("WATCHDOG=1", milliseconds(2000))) << i;
  done = true;
  slam.join();
}

TEST_F(HousekeeperTest, AFrameWithoutEndHangsWhateverStepsItMakes) {
  slam_.alive_ns.store(monotonicNs() + 10'000'000'000);
  slam_.frame_began_ns.store(monotonicNs() - 200'000'000'000);
  start(400'000'000);
  EXPECT_FALSE(reported("WATCHDOG=1", milliseconds(300)));
}

TEST_F(HousekeeperTest, ALoopThatHasEndedDoesNotHang) {
  slam_.alive_ns.store(monotonicNs() - 1'000'000'000);
  slam_.finished.store(true);
  start(400'000'000);
  EXPECT_TRUE(reported("WATCHDOG=1", milliseconds(2000)));
}

// A file that never stops being readable gets its turns, and nothing else suffers.
TEST_F(HousekeeperTest, ServesFilesAndTicksNevertheless) {
  const UniqueFd always(eventfd(1, EFD_CLOEXEC));
  const UniqueFd never(eventfd(0, EFD_CLOEXEC));
  std::atomic<int> served{0};
  std::atomic<int> served_at_ticks{0};
  std::atomic<int> healths{0};
  make(400'000'000);
  housekeeper_->watch(always.get(), [&] { ++served; });
  housekeeper_->watch(never.get(), [&] { ++served_at_ticks; });
  housekeeper_->setTap([&](const health_t&) { ++healths; });
  run();
  slam_.alive_ns.store(monotonicNs() + 10'000'000'000);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(reported("WATCHDOG=1", milliseconds(2000)));
  health_.writeBuffer().status = pose_t::STATUS_TRACKING;
  health_.publish();
  EXPECT_TRUE(reported("STATUS=tracking", milliseconds(2000)));
  housekeeper_->requestStop();
  thread_.join();
  EXPECT_GT(served, 10);
  EXPECT_GT(served_at_ticks, 0);
  EXPECT_EQ(healths, 1);
}

TEST_F(HousekeeperTest, TheServiceManagerKnowsTheState) {
  start(0);
  health_.writeBuffer().status = pose_t::STATUS_TRACKING;
  health_.publish();
  EXPECT_TRUE(reported("STATUS=tracking", milliseconds(2000)));
}

}  // namespace
}  // namespace waymark::daemon
