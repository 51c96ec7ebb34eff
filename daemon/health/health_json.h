// Health messages as JSON, for people and programs that do not speak LCM.
#pragma once

#include "io/text/json_node.h"
#include <waymark/health_t.hpp>

namespace waymark::daemon {

// Every field of the message by its own name, but: words in the place of numbers for `status` and
// the camera's state, and counters and temperatures as objects.
[[nodiscard]] io::Json healthJson(const health_t& health);

}  // namespace waymark::daemon
