#include "daemon/control/reload_signal.h"

#include <csignal>

#include <sys/signalfd.h>
#include <unistd.h>

namespace waymark::daemon {

ReloadSignal::ReloadSignal() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGHUP);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  signals_ = UniqueFd(signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK));
}

bool ReloadSignal::take() const {
  signalfd_siginfo signal{};
  return ::read(signals_.get(), &signal, sizeof signal) == sizeof signal;
}

}  // namespace waymark::daemon
