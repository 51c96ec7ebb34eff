// A client of the control socket, in the thread that serves it. Tests only.
#pragma once

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <string>

#include <sys/socket.h>
#include <sys/un.h>

#include "base/unique_fd.h"

namespace waymark::daemon::testing {

// Never waits.
class TestClient {
 public:
  explicit TestClient(const std::filesystem::path& path)
      : socket_(::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, path.c_str(), path.native().size());
    connected_ =
        ::connect(socket_.get(), reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  [[nodiscard]] bool connected() const { return connected_; }
  void send(const std::string& text) const {
    (void)::send(socket_.get(), text.data(), text.size(), MSG_NOSIGNAL);
  }
  // Says that nothing more will come.
  void finish() const { ::shutdown(socket_.get(), SHUT_WR); }
  void leave() { socket_ = UniqueFd(); }
  // All that has come; "<end>" when the server has hung up.
  [[nodiscard]] std::string received() const {
    std::string text;
    for (;;) {
      char bytes[4096];
      const ssize_t count = ::recv(socket_.get(), bytes, sizeof bytes, 0);
      if (count > 0) text.append(bytes, static_cast<std::size_t>(count));
      if (count == 0 || (count < 0 && errno == ECONNRESET)) return text + "<end>";
      if (count < 0) return text;
    }
  }

 private:
  UniqueFd socket_;
  bool connected_ = false;
};

}  // namespace waymark::daemon::testing
