// What the operating system does for threads that must not be late. Rejections say what would allow
// it; nothing else fails for want of it.
#pragma once

#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "base/result.h"

namespace waymark::daemon {

// All memory, now and later, stays in RAM, with page faults paid in advance.
Status lockMemory();

// SCHED_FIFO: the thread runs whenever it can, before all ordinary ones. priority: 1 to 99. `name`
// is for the message.
Status scheduleRealTime(std::thread& thread, const std::string& name, int priority);

// The thread runs on these processors (from 0) only. `name` is for the message.
Status pinToProcessors(std::thread& thread, const std::string& name, const std::vector<int>& cpus);

struct ThreadOptions {
  int priority = 0;       // of SCHED_FIFO; 0: scheduled like any other thread
  std::vector<int> cpus;  // processors that it may run on; empty: all
};

// A thread with a name that top and gdb show, at most 15 characters, and a stack that is in memory
// already. What the system rejects goes to `rejected`, and the thread runs without it.
[[nodiscard]] std::thread startThread(const std::string& name, const ThreadOptions& options,
                                      const std::function<void(const Error&)>& rejected,
                                      std::function<void()> run);

// The calling thread gives way to all others that want the processor: for long computations that
// nobody waits for. `name` is for the message.
Status lowerPriority(const std::string& name);

}  // namespace waymark::daemon
