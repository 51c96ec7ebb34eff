// A Unix socket on which clients ask in lines and get lines back. All of it happens in serve(),
// which never waits and does a bounded amount of work, whatever clients do.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include <sys/types.h>

#include "base/result.h"
#include "base/unique_fd.h"
#include "daemon/health/counter_source.h"

namespace waymark::daemon {

class ControlServer {
 public:
  struct Options {
    std::size_t max_clients = 16;
    std::size_t max_line_bytes = 4096;  // of a request, without its newline
    // A connection without a good request for so long is closed. Waiting for the daemon's answer
    // does not count.
    std::int64_t idle_ns = 10'000'000'000;
    // When all places are taken, a newcomer gets that of the client idle for longest, once that has
    // been for so long. Shorter serves more newcomers a second, longer leaves a slow client more
    // time for its request.
    std::int64_t grace_ns = 100'000'000;
    // Newcomers that wait for a place for so long, because all clients are busy, are rejected.
    std::int64_t patience_ns = 500'000'000;
  };

  using ClientId = std::uint64_t;  // never used again
  struct Answer {
    std::optional<std::string> line;  // without newline; empty: comes later, with answer()
    bool bad_request = false;         // for the counter
  };
  // Called within serve() with each request, a line without its newline. A client's next request is
  // looked at when this one is answered.
  using Handler = std::function<Answer(ClientId client, const std::string& request)>;

  // Listens on the socket, which only owner and group may use (mode 0660). A socket that a daemon
  // left behind is replaced; one on which another daemon listens, or any other file, is an error.
  [[nodiscard]] static Result<std::unique_ptr<ControlServer>> open(
      const std::filesystem::path& path, const Options& options);
  [[nodiscard]] static Result<std::unique_ptr<ControlServer>> open(
      const std::filesystem::path& path) {
    return open(path, Options{});
  }
  ControlServer(const ControlServer&) = delete;
  ControlServer& operator=(const ControlServer&) = delete;
  ~ControlServer();  // removes the file

  // What open() would say of this place on any day: too long a name, or something else is there.
  [[nodiscard]] static Status checkPlace(const std::filesystem::path& path);

  void setHandler(Handler handler) { handler_ = std::move(handler); }
  // Called within serve() with each client that has hung up while it waited for its answer.
  void setGoneHandler(std::function<void(ClientId)> gone) { gone_ = std::move(gone); }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

  // Readable when there is something to serve.
  [[nodiscard]] int fd() const { return events_.get(); }
  // To be called then, and now and then otherwise: it is time that makes a client idle.
  void serve(std::int64_t now_ns);
  // The answer to a request that was left open. The client may be gone.
  void answer(ClientId client, const std::string& line, std::int64_t now_ns);

  // Any thread. Names begin with "control.".
  void reportCounters(const CounterSink& sink) const;

 private:
  struct Client {
    UniqueFd socket;
    std::string in;              // read, not yet handled
    std::string out;             // answered, not yet sent
    bool waits = false;          // for a later answer
    bool ended = false;          // will send no more
    std::int64_t active_ns = 0;  // when it came, or the last good request was answered
  };
  struct Counters {
    std::atomic<std::uint64_t> requests{0};
    std::atomic<std::uint64_t> bad_requests{0};
    std::atomic<std::uint64_t> rejected_clients{0};  // all places were taken by busy ones
    std::atomic<std::uint64_t> dropped_clients{0};   // idle, or made place for another
  };

  ControlServer(std::filesystem::path path, UniqueFd listener, const Options& options);

  void acceptClients(std::int64_t now_ns);
  enum class Place { kFree, kLater, kNone };
  void admit(UniqueFd socket, std::int64_t now_ns);
  [[nodiscard]] Place findPlace(std::int64_t now_ns);
  void attendClients(std::int64_t now_ns);
  // False when the client is to be let go.
  [[nodiscard]] bool attend(ClientId id, Client* client, std::int64_t now_ns);
  [[nodiscard]] bool takeRequest(ClientId id, Client* client, std::int64_t now_ns);
  [[nodiscard]] static bool receive(Client* client);
  [[nodiscard]] static bool send(Client* client);
  [[nodiscard]] bool reject(const char* error, const Client& client);
  void watch(const Client& client) const;

  const std::filesystem::path path_;
  const Options options_;
  const UniqueFd listener_;
  const UniqueFd events_;  // an epoll instance
  const UniqueFd again_;   // an eventfd: requests are left that were read already
  Handler handler_;
  std::function<void(ClientId)> gone_;
  const ino_t inode_;
  std::map<ClientId, Client> clients_;
  ClientId next_id_ = 0;
  std::optional<std::int64_t> crowded_since_ns_;  // newcomers wait since then
  Counters counters_;
};

}  // namespace waymark::daemon
