// How parts of the daemon tell the publisher their counters, for health messages.
#pragma once

#include <cstdint>
#include <functional>

namespace waymark::daemon {

// Called with each counter: its name in health messages and its value since the start.
using CounterSink = std::function<void(const char* name, std::uint64_t value)>;
// Tells all counters of one part. Called from the publisher thread.
using CounterSource = std::function<void(const CounterSink&)>;

}  // namespace waymark::daemon
