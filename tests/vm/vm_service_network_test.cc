// Clock and network, which change under a running service.
#include <chrono>
#include <cstddef>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "tests/subscriber.h"
#include "tests/vm/service_fixture.h"
#include "tests/vm/wall_clock_steps.h"

namespace waymark::testing {
namespace {

using std::chrono::milliseconds;

void expectEveryFrame(const std::vector<pose_t>& frames) {
  for (std::size_t i = 1; i < frames.size(); ++i) {
    EXPECT_EQ(frames[i].sequence, frames[i - 1].sequence + 1) << "a frame was lost";
    EXPECT_GT(frames[i].monotonic_ns, frames[i - 1].monotonic_ns);
    EXPECT_LT(frames[i].monotonic_ns - frames[i - 1].monotonic_ns, 1'000'000'000);
  }
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
  expectTimesOf(stages, frames);
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

}  // namespace
}  // namespace waymark::testing
