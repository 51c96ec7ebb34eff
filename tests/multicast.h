// A place on the network for a test and the programs it starts.
#pragma once

#include <string>

namespace waymark::testing {

// An LCM group and port that nobody else is likely to use at the same time.
[[nodiscard]] std::string randomUrl();

// Is there a multicast route? If not, makes this process a network of its own where there is one.
// False when that is not allowed either.
[[nodiscard]] bool ensureMulticastRoute();

}  // namespace waymark::testing
