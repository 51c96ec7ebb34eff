#include "daemon/realtime.h"

#include <atomic>
#include <string>

#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace waymark::daemon {
namespace {

// A thread that waits for its end.
class Waiting {
 public:
  ~Waiting() {
    done_ = true;
    done_.notify_one();
    thread_.join();
  }
  [[nodiscard]] std::thread& thread() { return thread_; }

 private:
  std::atomic<bool> done_ = false;
  std::thread thread_{[this] { done_.wait(false); }};
};

// Either it has the priority, or it is told why not.
TEST(RealTime, AThreadHasItsPriorityOrTheReasonIsTold) {
  Waiting waiting;
  const Status scheduled = scheduleRealTime(waiting.thread(), "wm-slam", 7);
  int policy = 0;
  sched_param parameters{};
  ASSERT_EQ(pthread_getschedparam(waiting.thread().native_handle(), &policy, &parameters), 0);
  EXPECT_EQ(policy == SCHED_FIFO && parameters.sched_priority == 7, scheduled.ok());
  if (!scheduled) {
    EXPECT_NE(scheduled.error().message.find("RLIMIT_RTPRIO"), std::string::npos);
  }
}

// In a process of its own, which gives up what allows it.
template <typename Check>
bool holdsUnprivileged(const Check& check) {
  const pid_t child = fork();
  if (child == 0) {
    const rlimit none{0, 0};
    setrlimit(RLIMIT_RTPRIO, &none);
    setrlimit(RLIMIT_MEMLOCK, &none);
    if (getuid() == 0 && setuid(65534) != 0) _exit(2);
    _exit(check() ? 0 : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

TEST(RealTime, RefusalsNameTheLimit) {
  EXPECT_TRUE(holdsUnprivileged([] {
    Waiting waiting;
    const Status scheduled = scheduleRealTime(waiting.thread(), "wm-slam", 7);
    return !scheduled &&
           scheduled.error().message.starts_with("wm-slam runs without real-time priority 7: ") &&
           scheduled.error().message.find("LimitRTPRIO") != std::string::npos;
  }));
  EXPECT_TRUE(holdsUnprivileged([] {
    const Status locked = lockMemory();
    return !locked && locked.error().message.find("LimitMEMLOCK") != std::string::npos;
  }));
}

}  // namespace
}  // namespace waymark::daemon
