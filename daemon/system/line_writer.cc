#include "daemon/system/line_writer.h"

#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <csignal>
#include <mutex>
#include <string_view>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include "base/unique_fd.h"

namespace waymark::daemon {

struct LineWriter::State {
  UniqueFd file;
  LossLine loss_line;
  std::size_t max_lines = 0;

  std::mutex mutex;  // of what follows
  std::condition_variable changed;
  std::vector<std::string> waiting;
  bool writing = false;       // lines that were taken out are being written
  std::uint64_t written = 0;  // lines; grows while there is progress
  bool stop = false;

  std::atomic<std::uint64_t> lost{0};

  [[nodiscard]] bool idle() const { return waiting.empty() && !writing; }
};

LineWriter::LineWriter(int fd, LossLine loss_line, const Options& options)
    : state_(std::make_shared<State>()), options_(options) {
  state_->file = UniqueFd(::fcntl(fd, F_DUPFD_CLOEXEC, 0));
  state_->loss_line = std::move(loss_line);
  state_->max_lines = options.max_lines;
  state_->waiting.reserve(options.max_lines);
  // Signals are for others, and SIGPIPE, of a reader that has gone, for nobody.
  sigset_t all;
  sigset_t before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  thread_ = std::thread([state = state_] { run(state.get()); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  pthread_setname_np(thread_.native_handle(), "wm-log");
}

LineWriter::~LineWriter() {
  drain();
  std::unique_lock lock(state_->mutex);
  const bool hangs = !state_->idle();
  state_->stop = true;
  state_->changed.notify_all();
  lock.unlock();
  hangs ? thread_.detach() : thread_.join();
}

void LineWriter::add(std::string line) {
  {
    const std::lock_guard lock(state_->mutex);
    if (state_->waiting.size() < state_->max_lines) {
      state_->waiting.push_back(std::move(line));
    } else {
      state_->lost.fetch_add(1, std::memory_order_relaxed);
    }
  }
  state_->changed.notify_all();
}

void LineWriter::drain() {
  std::unique_lock lock(state_->mutex);
  while (!state_->idle()) {
    const std::uint64_t before = state_->written;
    const auto moves = [&] { return state_->idle() || state_->written != before; };
    if (!state_->changed.wait_for(lock, options_.patience, moves)) return;
  }
}

std::uint64_t LineWriter::lost() const { return state_->lost.load(std::memory_order_relaxed); }

void LineWriter::run(State* state) {
  std::vector<std::string> lines;
  lines.reserve(state->max_lines);
  std::uint64_t told = 0;  // of those lost
  std::unique_lock lock(state->mutex);
  while (!state->stop) {
    if (state->waiting.empty()) {
      state->writing = false;
      state->changed.notify_all();
      state->changed.wait(lock);
      continue;
    }
    state->writing = true;
    lines.swap(state->waiting);
    // Up to now, and so later than these lines: they had the room.
    const std::uint64_t lost = state->lost.load(std::memory_order_relaxed);
    lock.unlock();
    writeAll(state, lines);
    lines.clear();
    if (lost > told) {
      writeAll(state, {state->loss_line(lost - told)});
      told = lost;
    }
    lock.lock();
  }
}

// Ends early with the object.
void LineWriter::writeAll(State* state, const std::vector<std::string>& lines) {
  for (const std::string& line : lines) {
    write(state, line);
    const std::lock_guard lock(state->mutex);
    ++state->written;
    state->changed.notify_all();
    if (state->stop) return;
  }
}

// Whoever shares the file may have made it one that does not wait.
void LineWriter::write(State* state, const std::string& line) {
  for (std::string_view rest = line; !rest.empty();) {
    const ssize_t count = ::write(state->file.get(), rest.data(), rest.size());
    if (count >= 0) {
      rest.remove_prefix(static_cast<std::size_t>(count));
    } else if (errno == EAGAIN) {
      pollfd writable{state->file.get(), POLLOUT, 0};
      ::poll(&writable, 1, -1);
    } else if (errno != EINTR) {
      state->lost.fetch_add(1, std::memory_order_relaxed);
      return;
    }
  }
}

}  // namespace waymark::daemon
