#include "daemon/control/control_server.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>
#include <utility>

#include <fcntl.h>
#include <poll.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include "base/system_reason.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

constexpr int kBacklog = 64;  // newcomers that wait for their turn
constexpr mode_t kMode = 0660;

constexpr const char* kTooLong = "the request is too long";
constexpr const char* kNoNewline = "the request does not end with a newline";
constexpr const char* kIdle = "idle for too long";
constexpr const char* kGaveWay = "idle while others waited for a place";
constexpr const char* kFull = "all places are taken by busy clients";

// Our own texts, which need no escaping.
std::string errorLine(const char* error) {
  return std::string(R"({"ok":false,"error":")") + error + "\"}\n";
}

// What does not fit into the client's buffer is lost.
void sendAtOnce(int socket, const std::string& text) {
  (void)::send(socket, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
}

bool has(int fd, short event) {
  pollfd file{fd, event, 0};
  return ::poll(&file, 1, 0) > 0;
}

UniqueFd newSocket() {
  return UniqueFd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
}

// Precondition: the path fits.
sockaddr_un addressOf(const fs::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.native().size());
  return address;
}

ino_t inodeOf(const fs::path& path) {
  struct stat file {};
  return ::lstat(path.c_str(), &file) == 0 ? file.st_ino : 0;
}

// Between bind and listen a socket looks abandoned: daemons that make theirs in one directory do so
// one after the other. Held until the descriptor is closed; empty where the directory cannot be
// opened.
Result<UniqueFd> lockDirectoryOf(const fs::path& path) {
  using std::chrono_literals::operator""ms;
  constexpr auto kPause = 10ms;
  constexpr int kAttempts = 500;  // making a socket takes less than a millisecond
  const fs::path directory = path.has_parent_path() ? path.parent_path() : fs::path(".");
  UniqueFd lock(::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  for (int i = 0; lock && ::flock(lock.get(), LOCK_EX | LOCK_NB) != 0; ++i) {
    if (errno != EWOULDBLOCK && errno != EINTR) return UniqueFd();  // a file system without locks
    if (i == kAttempts) {
      return Error{directory.string() + ": another program keeps this directory locked"};
    }
    std::this_thread::sleep_for(kPause);
  }
  return lock;
}

// What stands in the socket's place: an abandoned socket goes away.
Status clearPlace(const fs::path& path, const sockaddr_un& address) {
  if (inodeOf(path) == 0) return success();  // bind knows what is wrong, if anything
  const UniqueFd probe = newSocket();
  const int outcome =
      ::connect(probe.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address);
  if (outcome == 0 || errno == EAGAIN) {
    return Error{path.string() + ": another daemon listens on this control socket"};
  }
  if (errno != ECONNREFUSED || ::unlink(path.c_str()) != 0) {
    return Error{path.string() + ": the old control socket cannot be replaced: " + systemReason()};
  }
  return success();
}

}  // namespace

Status ControlServer::checkPlace(const fs::path& path) {
  if (path.native().size() >= sizeof(sockaddr_un::sun_path)) {
    return Error{path.string() + ": too long for a socket's name; the system takes " +
                 std::to_string(sizeof(sockaddr_un::sun_path) - 1) + " bytes"};
  }
  struct stat file {};
  if (::lstat(path.c_str(), &file) == 0 && !S_ISSOCK(file.st_mode)) {
    return Error{path.string() + ": is a file, where the control socket should be"};
  }
  return success();
}

Result<std::unique_ptr<ControlServer>> ControlServer::open(const fs::path& path,
                                                           const Options& options) {
  if (const Status place = checkPlace(path); !place) return place.error();
  const Result<UniqueFd> lock = lockDirectoryOf(path);
  if (!lock) return lock.error();
  const sockaddr_un address = addressOf(path);
  if (const Status clear = clearPlace(path, address); !clear) return clear.error();
  UniqueFd listener = newSocket();
  // The mode is set before there is a file, and again for what the umask took away. Nobody can
  // connect before listen.
  if (!listener || ::fchmod(listener.get(), kMode) != 0 ||
      ::bind(listener.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      ::chmod(path.c_str(), kMode) != 0 || ::listen(listener.get(), kBacklog) != 0) {
    return Error{path.string() + ": the control socket cannot be made: " + systemReason()};
  }
  return std::unique_ptr<ControlServer>(new ControlServer(path, std::move(listener), options));
}

ControlServer::ControlServer(fs::path path, UniqueFd listener, const Options& options)
    : path_(std::move(path)),
      options_(options),
      listener_(std::move(listener)),
      events_(::epoll_create1(EPOLL_CLOEXEC)),
      again_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      inode_(inodeOf(path_)) {
  epoll_event readable{};
  readable.events = EPOLLIN;
  ::epoll_ctl(events_.get(), EPOLL_CTL_ADD, listener_.get(), &readable);
  ::epoll_ctl(events_.get(), EPOLL_CTL_ADD, again_.get(), &readable);
}

// Unless somebody has put another file there.
ControlServer::~ControlServer() {
  if (inodeOf(path_) == inode_) ::unlink(path_.c_str());
}

void ControlServer::serve(std::int64_t now_ns) {
  eventfd_t ignored = 0;
  ::eventfd_read(again_.get(), &ignored);
  acceptClients(now_ns);
  attendClients(now_ns);
}

void ControlServer::acceptClients(std::int64_t now_ns) {
  for (std::size_t i = 0; i < options_.max_clients && has(listener_.get(), POLLIN); ++i) {
    Place place = findPlace(now_ns);
    if (place == Place::kFree) {
      crowded_since_ns_.reset();
    } else if (!crowded_since_ns_) {
      crowded_since_ns_ = now_ns;
    } else if (now_ns - *crowded_since_ns_ >= options_.patience_ns) {
      place = Place::kNone;
    }
    if (place == Place::kLater) return;
    UniqueFd socket(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
    if (!socket) return;
    if (place == Place::kFree) {
      admit(std::move(socket), now_ns);
    } else {
      sendAtOnce(socket.get(), errorLine(kFull));
      counters_.rejected_clients.fetch_add(1, std::memory_order_relaxed);
    }
  }
  if (!has(listener_.get(), POLLIN)) crowded_since_ns_.reset();
}

void ControlServer::admit(UniqueFd socket, std::int64_t now_ns) {
  epoll_event readable{};
  readable.events = EPOLLIN;
  ::epoll_ctl(events_.get(), EPOLL_CTL_ADD, socket.get(), &readable);
  Client& client = clients_[next_id_++];
  client.socket = std::move(socket);
  client.active_ns = now_ns;
}

// A place for a newcomer, where needed that of the client idle for longest.
ControlServer::Place ControlServer::findPlace(std::int64_t now_ns) {
  if (clients_.size() < options_.max_clients) return Place::kFree;
  auto idlest = clients_.end();
  for (auto client = clients_.begin(); client != clients_.end(); ++client) {
    if (client->second.waits) continue;
    if (idlest == clients_.end() || client->second.active_ns < idlest->second.active_ns) {
      idlest = client;
    }
  }
  if (idlest == clients_.end()) return Place::kNone;
  if (now_ns - idlest->second.active_ns < options_.grace_ns) return Place::kLater;
  counters_.dropped_clients.fetch_add(1, std::memory_order_relaxed);
  if (idlest->second.out.empty()) sendAtOnce(idlest->second.socket.get(), errorLine(kGaveWay));
  clients_.erase(idlest);
  return Place::kFree;
}

void ControlServer::attendClients(std::int64_t now_ns) {
  for (auto client = clients_.begin(); client != clients_.end();) {
    const bool waited = client->second.waits;
    const bool stays = attend(client->first, &client->second, now_ns);
    if (waited && !stays && gone_) gone_(client->first);
    client = stays ? std::next(client) : clients_.erase(client);
  }
}

bool ControlServer::attend(ClientId id, Client* client, std::int64_t now_ns) {
  // Whoever has gone needs no answer.
  if (client->waits) return !has(client->socket.get(), 0);
  if (!client->out.empty() && !send(client)) return false;
  if (client->out.empty() && !takeRequest(id, client, now_ns)) return false;
  if (!client->waits && now_ns - client->active_ns > options_.idle_ns) {
    counters_.dropped_clients.fetch_add(1, std::memory_order_relaxed);
    if (client->out.empty()) sendAtOnce(client->socket.get(), errorLine(kIdle));
    return false;
  }
  watch(*client);
  return true;
}

// One request at most: the others have their turn first.
bool ControlServer::takeRequest(ClientId id, Client* client, std::int64_t now_ns) {
  std::size_t end = client->in.find('\n');
  if (end == std::string::npos) {
    if (!receive(client)) return false;
    end = client->in.find('\n');
  }
  if (std::min(end, client->in.size()) > options_.max_line_bytes) return reject(kTooLong, *client);
  if (end == std::string::npos) {
    if (!client->ended) return true;
    return client->in.empty() ? false : reject(kNoNewline, *client);
  }
  const std::string request = client->in.substr(0, end);
  client->in.erase(0, end + 1);
  counters_.requests.fetch_add(1, std::memory_order_relaxed);
  Answer answer = handler_(id, request);
  if (answer.bad_request) {
    counters_.bad_requests.fetch_add(1, std::memory_order_relaxed);
  } else {
    client->active_ns = now_ns;
  }
  client->waits = !answer.line;
  if (client->waits) return true;
  client->out = std::move(*answer.line) + "\n";
  return send(client);
}

bool ControlServer::receive(Client* client) {
  std::array<char, 4096> bytes{};
  const ssize_t count = ::recv(client->socket.get(), bytes.data(), bytes.size(), 0);
  if (count < 0) return errno == EAGAIN || errno == EINTR;
  if (count == 0) client->ended = true;
  client->in.append(bytes.data(), static_cast<std::size_t>(count));
  return true;
}

bool ControlServer::reject(const char* error, const Client& client) {
  counters_.requests.fetch_add(1, std::memory_order_relaxed);
  counters_.bad_requests.fetch_add(1, std::memory_order_relaxed);
  sendAtOnce(client.socket.get(), errorLine(error));
  return false;
}

bool ControlServer::send(Client* client) {
  const ssize_t count =
      ::send(client->socket.get(), client->out.data(), client->out.size(), MSG_NOSIGNAL);
  if (count < 0) return errno == EAGAIN || errno == EINTR;
  client->out.erase(0, static_cast<std::size_t>(count));
  return true;
}

void ControlServer::answer(ClientId id, const std::string& line, std::int64_t now_ns) {
  const auto client = clients_.find(id);
  if (client == clients_.end() || !client->second.waits) return;
  client->second.waits = false;
  client->second.out = line + "\n";
  client->second.active_ns = now_ns;
  if (!attend(id, &client->second, now_ns)) clients_.erase(client);
}

// What to be woken for. A client that waits for its answer, or does not take it, is not listened
// to.
void ControlServer::watch(const Client& client) const {
  const bool listens = client.out.empty() && !client.waits;
  epoll_event event{};
  if (listens && !client.ended) event.events = EPOLLIN;
  if (!client.out.empty()) event.events = EPOLLOUT;
  ::epoll_ctl(events_.get(), EPOLL_CTL_MOD, client.socket.get(), &event);
  const bool more = client.ended || client.in.find('\n') != std::string::npos;
  if (listens && more) ::eventfd_write(again_.get(), 1);
}

void ControlServer::reportCounters(const CounterSink& sink) const {
  sink("control.requests", counters_.requests.load(std::memory_order_relaxed));
  sink("control.bad_requests", counters_.bad_requests.load(std::memory_order_relaxed));
  sink("control.refused_clients", counters_.rejected_clients.load(std::memory_order_relaxed));
  sink("control.dropped_clients", counters_.dropped_clients.load(std::memory_order_relaxed));
}

}  // namespace waymark::daemon
