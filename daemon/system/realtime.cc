#include "daemon/system/realtime.h"

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <utility>

#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>

namespace waymark::daemon {
namespace {

// Writes to as much of the calling thread's stack as it will ever use, so that no page of it is
// missing when a frame is waiting.
void prefaultStack() {
  constexpr std::size_t kBytes = std::size_t{512} << 10U;
  constexpr std::size_t kPage = 4096;
  std::array<volatile char, kBytes> stack;
  for (std::size_t i = 0; i < kBytes; i += kPage) stack[i] = 0;
}

}  // namespace

Status lockMemory() {
  if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0) return success();
  return Error{std::string("memory is not locked: ") + std::strerror(errno) +
               " (the limit is RLIMIT_MEMLOCK, LimitMEMLOCK= of a service)"};
}

Status scheduleRealTime(std::thread& thread, const std::string& name, int priority) {
  sched_param parameters{};
  parameters.sched_priority = priority;
  const int error = pthread_setschedparam(thread.native_handle(), SCHED_FIFO, &parameters);
  if (error == 0) return success();
  return Error{name + " runs without real-time priority " + std::to_string(priority) + ": " +
               std::strerror(error) + " (the limit is RLIMIT_RTPRIO, LimitRTPRIO= of a service)"};
}

Status pinToProcessors(std::thread& thread, const std::string& name, const std::vector<int>& cpus) {
  cpu_set_t set;
  CPU_ZERO(&set);
  std::string wanted;
  for (const int cpu : cpus) {
    CPU_SET(static_cast<std::size_t>(cpu), &set);
    wanted += (wanted.empty() ? "" : ", ") + std::to_string(cpu);
  }
  const int error = pthread_setaffinity_np(thread.native_handle(), sizeof set, &set);
  if (error == 0) return success();
  return Error{name + " is not bound to processor " + wanted + ": " + std::strerror(error)};
}

std::thread startThread(const std::string& name, const ThreadOptions& options,
                        const std::function<void(const Error&)>& rejected,
                        std::function<void()> run) {
  std::thread thread([run = std::move(run)] {
    prefaultStack();
    run();
  });
  pthread_setname_np(thread.native_handle(), name.c_str());
  if (options.priority > 0) {
    if (const Status s = scheduleRealTime(thread, name, options.priority); !s) rejected(s.error());
  }
  if (!options.cpus.empty()) {
    if (const Status s = pinToProcessors(thread, name, options.cpus); !s) rejected(s.error());
  }
  return thread;
}

// In Linux a thread has a priority of its own. Lowering it is always allowed, but for filters of
// system calls.
Status lowerPriority(const std::string& name) {
  constexpr int kNice = 10;
  if (::setpriority(PRIO_PROCESS, 0, kNice) == 0) return success();
  return Error{name + " does not give way to other threads: " + std::strerror(errno)};
}

}  // namespace waymark::daemon
