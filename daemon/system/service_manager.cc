#include "daemon/system/service_manager.h"

#include <systemd/sd-daemon.h>

#include "base/clock.h"

namespace waymark::daemon {
namespace {

// Nothing can be done about a service manager that does not listen.
void tell(const std::string& state) { (void)sd_notify(0, state.c_str()); }

}  // namespace

void ServiceManager::ready() const { tell("READY=1"); }

void ServiceManager::stopping() const { tell("STOPPING=1"); }

void ServiceManager::reloading() const {
  tell("RELOADING=1\nMONOTONIC_USEC=" + std::to_string(monotonicNs() / 1000));
}

void ServiceManager::status(const std::string& text) const { tell("STATUS=" + text); }

void ServiceManager::alive() const { tell("WATCHDOG=1"); }

std::int64_t ServiceManager::watchdogNs() {
  std::uint64_t interval_us = 0;
  if (sd_watchdog_enabled(0, &interval_us) <= 0) return 0;
  return static_cast<std::int64_t>(interval_us) * 1000;
}

}  // namespace waymark::daemon
