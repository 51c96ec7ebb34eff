// The way out to LCM subscribers, which may come and go with the network: it is opened when it can
// be, retried with growing pauses when not, and says so once.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <lcm/lcm.h>
#include <netinet/in.h>

#include "daemon/system/log.h"

namespace waymark::daemon {

// The address in "udpm://GROUP:PORT?...", which must be an IPv4 multicast one. Group and port may
// be left out, as LCM allows. Empty for anything else.
[[nodiscard]] std::optional<sockaddr_in> multicastAddress(const std::string& url);

// Of the options behind the "?", which LCM itself only warns of, or fails with for ever: which is
// wrong. Precondition: multicastAddress(url) is not empty.
[[nodiscard]] std::optional<std::string> wrongUrlOption(const std::string& url);

// Could a message be sent there now? Without a route, lcm_create fails and fills stderr.
[[nodiscard]] bool hasRoute(const sockaddr_in& address);

// Publishes through an lcm_t of its own. For one thread.
class LcmLink {
 public:
  // Precondition: multicastAddress(url) is not empty.
  LcmLink(const std::string& url, const Log& log);

  // Opens the link when it is down and the time for the next attempt has come. Returns whether it
  // is up.
  bool maintain(std::int64_t now_ns);

  // False when the link is down, or just went down while sending this.
  bool publish(const std::string& channel, std::span<const std::uint8_t> bytes);

  [[nodiscard]] bool up() const { return lcm_ != nullptr; }

 private:
  struct LcmClose {
    void operator()(lcm_t* lcm) const { lcm_destroy(lcm); }
  };

  void lost(const std::string& reason);

  const std::string url_;
  const sockaddr_in address_;
  const Log& log_;
  std::unique_ptr<lcm_t, LcmClose> lcm_;
  bool reported_lost_ = false;
  std::int64_t next_attempt_ns_ = 0;
  std::int64_t pause_ns_;
};

}  // namespace waymark::daemon
