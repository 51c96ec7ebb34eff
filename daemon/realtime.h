// What the operating system does for threads that must not be late. Refusals say what would allow
// it; nothing else fails for want of it.
#pragma once

#include <string>
#include <thread>

#include "base/result.h"

namespace waymark::daemon {

// All memory, now and later, stays in RAM, with page faults paid in advance.
Status lockMemory();

// SCHED_FIFO: the thread runs whenever it can, before all ordinary ones. priority: 1 to 99. `name`
// is for the message.
Status scheduleRealTime(std::thread& thread, const std::string& name, int priority);

// The calling thread gives way to all others that want the processor: for long computations that
// nobody waits for.
void giveWay();

}  // namespace waymark::daemon
