#include "daemon/realtime.h"

#include <cerrno>
#include <cstring>

#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>

namespace waymark::daemon {

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

// In Linux a thread has a priority of its own. Lowering it is always allowed.
void giveWay() {
  constexpr int kNice = 10;
  (void)::setpriority(PRIO_PROCESS, 0, kNice);
}

}  // namespace waymark::daemon
