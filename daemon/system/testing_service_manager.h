// A service manager that writes down what it is told. Tests only.
#pragma once

#include <array>
#include <cstdlib>
#include <cstring>
#include <string>

#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>

#include "base/unique_fd.h"

namespace waymark::daemon::testing {

// Listens as long as it lives, in the abstract namespace, and is in the environment.
class NotifySocket {
 public:
  NotifySocket() : fd_(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    const std::string name = "@waymark-test-" + std::to_string(getpid());
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name.data(), name.size());
    address.sun_path[0] = '\0';
    const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    listens_ = bind(fd_.get(), reinterpret_cast<sockaddr*>(&address), length) == 0;
    setenv("NOTIFY_SOCKET", name.c_str(), 1);
  }
  ~NotifySocket() { unsetenv("NOTIFY_SOCKET"); }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;

  [[nodiscard]] bool listens() const { return listens_; }

  // The next message; empty when none comes in time.
  [[nodiscard]] std::string next(int timeout_ms) const {
    pollfd readable{fd_.get(), POLLIN, 0};
    if (poll(&readable, 1, timeout_ms) <= 0) return {};
    std::array<char, 4096> text{};
    const ssize_t size = recv(fd_.get(), text.data(), text.size(), 0);
    return size > 0 ? std::string(text.data(), static_cast<std::size_t>(size)) : std::string();
  }

 private:
  UniqueFd fd_;
  bool listens_ = false;
};

}  // namespace waymark::daemon::testing
