#include "daemon/control/stop_signal.h"

#include <array>
#include <csignal>

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>

namespace waymark::daemon {

namespace {

sigset_t stopSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  return signals;
}

}  // namespace

StopSignal::StopSignal() : finished_(eventfd(0, EFD_CLOEXEC)) {
  const sigset_t signals = stopSignals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  signals_ = UniqueFd(signalfd(-1, &signals, SFD_CLOEXEC));
}

void StopSignal::wait() {
  while (!poll(-1)) {
  }
}

bool StopSignal::pending() const { return poll(0); }

void StopSignal::finish() { eventfd_write(finished_.get(), 1); }

void StopSignal::release() {
  const sigset_t signals = stopSignals();
  pthread_sigmask(SIG_UNBLOCK, &signals, nullptr);
}

bool StopSignal::poll(int timeout_ms) const {
  std::array<pollfd, 2> files{pollfd{signals_.get(), POLLIN, 0},
                              pollfd{finished_.get(), POLLIN, 0}};
  return ::poll(files.data(), files.size(), timeout_ms) > 0;
}

}  // namespace waymark::daemon
