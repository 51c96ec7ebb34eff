#include "daemon/system/realtime.h"

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstddef>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <pthread.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
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

// From now on these calls fail with EPERM, in this process.
bool refuseCalls(const std::array<unsigned, 2>& calls) {
  std::array<sock_filter, 5> code = {
      sock_filter BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
      sock_filter BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, calls[0], 1, 0),
      sock_filter BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, calls[1], 0, 1),
      sock_filter BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM),
      sock_filter BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW)};
  const sock_fprog program{code.size(), code.data()};
  return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
         prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
}

TEST(RealTime, AThreadRunsWhereItIsBoundTo) {
  int where = -1;
  std::vector<std::string> rejected;
  std::thread bound = startThread(
      "wm-test", {.cpus = {0}}, [&](const Error& error) { rejected.push_back(error.message); },
      [&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        where = sched_getcpu();
      });
  std::array<char, 16> name{};
  pthread_getname_np(bound.native_handle(), name.data(), name.size());
  EXPECT_STREQ(name.data(), "wm-test");
  bound.join();
  EXPECT_EQ(where, 0);
  EXPECT_TRUE(rejected.empty());
}

TEST(RealTime, AProcessorThatIsNotThereIsRejectedAndNamed) {
  std::vector<std::string> rejected;
  bool ran = false;
  startThread(
      "wm-test", {.cpus = {1000}}, [&](const Error& error) { rejected.push_back(error.message); },
      [&] { ran = true; })
      .join();
  EXPECT_TRUE(ran) << "all the same";
  ASSERT_EQ(rejected.size(), 1U);
  EXPECT_TRUE(rejected[0].starts_with("wm-test is not bound to processor 1000: ")) << rejected[0];
}

// In a process whose system calls are filtered as by a unit that does not allow them.
TEST(RealTime, WhatAFilterRefusesIsTold) {
  EXPECT_TRUE(holdsUnprivileged([] {
    if (!refuseCalls({__NR_setpriority, __NR_sched_setaffinity})) return false;
    const Status lowered = lowerPriority("wm-maps");
    int rejections = 0;
    startThread(
        "wm-test", {.cpus = {0}}, [&](const Error&) { ++rejections; }, [] {})
        .join();
    return !lowered &&
           lowered.error().message ==
               "wm-maps does not give way to other threads: Operation not permitted" &&
           rejections == 1;
  }));
}

TEST(RealTime, AThreadGivesWay) {
  int nice = 0;
  std::thread([&] {
    EXPECT_TRUE(lowerPriority("wm-test"));
    nice = ::getpriority(PRIO_PROCESS, 0);
  }).join();
  EXPECT_EQ(nice, 10);
}

TEST(RealTime, RejectionsNameTheLimit) {
  EXPECT_TRUE(holdsUnprivileged([] {
    Waiting waiting;
    const Status scheduled = scheduleRealTime(waiting.thread(), "wm-slam", 7);
    return !scheduled &&
           scheduled.error().message.starts_with("wm-slam runs without real-time priority 7: ") &&
           scheduled.error().message.find("LimitRTPRIO") != std::string::npos;
  }));
#ifdef __SANITIZE_ADDRESS__
  GTEST_SKIP() << "the address sanitizer has mlockall() do nothing";
#endif
  EXPECT_TRUE(holdsUnprivileged([] {
    const Status locked = lockMemory();
    return !locked && locked.error().message.find("LimitMEMLOCK") != std::string::npos;
  }));
}

}  // namespace
}  // namespace waymark::daemon
