#include "tools/control_client.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>

#include "base/clock.h"
#include "base/system_reason.h"
#include "base/unique_fd.h"

namespace waymark::tools {
namespace {

namespace fs = std::filesystem;

// A connection with one point in time at which patience ends.
class Connection {
 public:
  Connection(const fs::path& path, std::chrono::milliseconds timeout)
      : path_(path),
        until_ns_(monotonicNs() + std::chrono::nanoseconds(timeout).count()),
        socket_(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {}

  Status open() {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    if (path_.native().size() >= sizeof address.sun_path) return error("is too long a name");
    std::memcpy(address.sun_path, path_.c_str(), path_.native().size());
    // Waiting for a place in the daemon's queue is the only thing that needs a socket that blocks:
    // those that wait so come in turn.
    const std::int64_t left_us = (until_ns_ - monotonicNs()) / 1000;
    const timeval patience{left_us / 1'000'000, left_us % 1'000'000};
    ::setsockopt(socket_.get(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
    if (::connect(socket_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) !=
        0) {
      if (errno == ENOENT || errno == ECONNREFUSED) return error("no daemon listens there");
      if (errno == EAGAIN) return error("the daemon has no place for us");
      return error(systemReason());
    }
    ::fcntl(socket_.get(), F_SETFL, O_NONBLOCK);
    return success();
  }

  Status send(std::string text) {
    while (!text.empty()) {
      const ssize_t count = ::send(socket_.get(), text.data(), text.size(), MSG_NOSIGNAL);
      if (count >= 0) {
        text.erase(0, static_cast<std::size_t>(count));
      } else if (errno == EPIPE || errno == ECONNRESET) {
        return success();  // it may have said why before it hung up
      } else if (Status ready = wait(POLLOUT); !ready) {
        return ready;
      }
    }
    return success();
  }

  Result<std::string> receiveLine() {
    std::string text;
    std::array<char, 4096> bytes{};
    for (;;) {
      const ssize_t count = ::recv(socket_.get(), bytes.data(), bytes.size(), 0);
      if (count > 0) {
        text.append(bytes.data(), static_cast<std::size_t>(count));
        if (const auto end = text.find('\n'); end != std::string::npos) return text.substr(0, end);
      } else if (count == 0 || errno == ECONNRESET) {
        return error("the daemon hung up without an answer").error();
      } else if (errno != EAGAIN && errno != EINTR) {
        return error(systemReason()).error();
      } else if (const Status ready = wait(POLLIN); !ready) {
        return ready.error();
      }
    }
  }

 private:
  [[nodiscard]] Status error(const std::string& reason) const {
    return Error{path_.string() + ": " + reason};
  }
  Status wait(short event) {
    const std::int64_t left_ms = (until_ns_ - monotonicNs()) / 1'000'000;
    pollfd file{socket_.get(), event, 0};
    if (left_ms <= 0 || ::poll(&file, 1, static_cast<int>(left_ms)) == 0) {
      return error("no answer in time");
    }
    return success();
  }

  const fs::path& path_;
  const std::int64_t until_ns_;
  const UniqueFd socket_;
};

}  // namespace

Result<io::Json> askDaemon(const fs::path& socket, const io::Json& request,
                           std::chrono::milliseconds timeout) {
  Connection connection(socket, timeout);
  if (const Status open = connection.open(); !open) return open.error();
  if (const Status sent = connection.send(request.dump() + "\n"); !sent) return sent.error();
  const Result<std::string> line = connection.receiveLine();
  if (!line) return line.error();
  Result<io::Json> reply = io::parseJson(*line, socket.string() + ": reply");
  if (!reply) return reply.error();
  const auto ok = reply->find("ok");
  if (!reply->is_object() || ok == reply->end() || !ok->is_boolean()) {
    return Error{socket.string() + ": reply: is not a daemon's"};
  }
  return reply;
}

}  // namespace waymark::tools
