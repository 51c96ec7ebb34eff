// What systemd wants to hear from a service of Type=notify: sd_notify(3). Where nobody listens,
// telling does nothing.
#pragma once

#include <cstdint>
#include <string>

namespace waymark::daemon {

class ServiceManager {
 public:
  void ready() const;
  void stopping() const;
  // Between the two of them the service manager shows that it is being reloaded.
  void reloading() const;
  void reloaded() const { ready(); }
  // One line for `systemctl status`.
  void status(const std::string& text) const;
  // Feeds the watchdog.
  void alive() const;

  // How long the watchdog waits for alive(), nanoseconds; 0: there is none for this process.
  [[nodiscard]] static std::int64_t watchdogNs();
};

}  // namespace waymark::daemon
