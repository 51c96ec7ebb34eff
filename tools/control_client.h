// The other end of the daemon's control socket: one request, one reply.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>

#include "base/result.h"
#include "io/text/json_node.h"

namespace waymark::tools {

// Sends the request as a line and waits for a line. Errors name the socket: nobody listens there,
// no reply in time, no JSON.
[[nodiscard]] Result<io::Json> askDaemon(const std::filesystem::path& socket,
                                         const io::Json& request,
                                         std::chrono::milliseconds timeout);

}  // namespace waymark::tools
