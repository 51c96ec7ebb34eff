// Where the control socket is when the configuration does not say, and where to look for one.
#pragma once

#include <filesystem>
#include <vector>

namespace waymark::daemon {

// In the directory that systemd made for this service; empty where it made none.
[[nodiscard]] std::filesystem::path serviceSocket();

// Of a daemon that somebody starts by hand: waymark/control.sock in the runtime directory of who is
// logged in ($XDG_RUNTIME_DIR, else /run/user/UID). Empty where there is no such directory.
[[nodiscard]] std::filesystem::path userSocket();

// Where daemons listen that nobody has told otherwise: the service's place first.
[[nodiscard]] std::vector<std::filesystem::path> usualSockets();

}  // namespace waymark::daemon
