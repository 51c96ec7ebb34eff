#include "daemon/publish/lcm_link.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <string_view>

#include <arpa/inet.h>
#include <sys/socket.h>

#include "base/clock.h"
#include "base/system_reason.h"
#include "base/unique_fd.h"

namespace waymark::daemon {
namespace {

constexpr std::string_view kScheme = "udpm://";
constexpr std::string_view kDefaultGroup = "239.255.76.67";  // LCM's own
constexpr std::uint16_t kDefaultPort = 7667;

constexpr std::int64_t kFirstPauseNs = 100'000'000;
constexpr std::int64_t kMaxPauseNs = 5'000'000'000;

// A datagram socket that has the address as its peer; -1 (and errno) without a route.
UniqueFd connectTo(const sockaddr_in& address) {
  UniqueFd fd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (!fd) return fd;
  if (connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    return {};
  return fd;
}

}  // namespace

std::optional<sockaddr_in> multicastAddress(const std::string& url) {
  if (!url.starts_with(kScheme)) return {};
  std::string_view place = std::string_view(url).substr(kScheme.size());
  place = place.substr(0, place.find('?'));
  const std::size_t colon = place.find(':');
  const std::string_view group =
      colon == 0 || place.empty() ? kDefaultGroup : place.substr(0, colon);

  sockaddr_in address{};
  address.sin_family = AF_INET;
  std::uint16_t port = kDefaultPort;
  if (colon != place.npos) {
    const std::string_view digits = place.substr(colon + 1);
    const char* end = digits.data() + digits.size();
    const auto [stop, error] = std::from_chars(digits.data(), end, port);
    if (error != std::errc{} || stop != end || port == 0) return {};
  }
  address.sin_port = htons(port);
  if (inet_pton(AF_INET, std::string(group).c_str(), &address.sin_addr) != 1) return {};
  if (!IN_MULTICAST(ntohl(address.sin_addr.s_addr))) return {};
  return address;
}

std::optional<std::string> wrongUrlOption(const std::string& url) {
  constexpr int kMaxTtl = 255;
  const std::size_t mark = url.find('?');
  std::string_view rest = mark == url.npos ? "" : std::string_view(url).substr(mark + 1);
  while (!rest.empty()) {
    const std::string_view option = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(option.size() + 1, rest.size()));
    const std::string_view name = option.substr(0, option.find('='));
    const std::string_view text = option.substr(std::min(name.size() + 1, option.size()));
    int value = 0;
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    const bool whole = !text.empty() && error == std::errc{} && stop == end;
    if (name == "ttl") {
      if (!whole || value < 0 || value > kMaxTtl) return "its ttl must be from 0 to 255";
    } else if (name == "recv_buf_size") {
      if (!whole || value <= 0) return "its recv_buf_size must be a positive number of bytes";
    } else {
      return "may have the options ttl and recv_buf_size, joined by \"&\", and not \"" +
             std::string(option) + "\"";
    }
  }
  return {};
}

bool hasRoute(const sockaddr_in& address) { return static_cast<bool>(connectTo(address)); }

LcmLink::LcmLink(const std::string& url, const Log& log)
    : url_(url), address_(*multicastAddress(url)), log_(log), pause_ns_(kFirstPauseNs) {}

bool LcmLink::maintain(std::int64_t now_ns) {
  if (up()) return true;
  if (now_ns < next_attempt_ns_) return false;
  if (!hasRoute(address_)) {
    lost(errno == ENETUNREACH ? "there is no multicast route" : systemReason());
  } else {
    lcm_.reset(lcm_create(url_.c_str()));
    if (!up()) lost("LCM refuses it");
  }
  if (up()) {
    log_.info(reported_lost_ ? "publishing to " + url_ + " again" : "publishing to " + url_);
    reported_lost_ = false;
    pause_ns_ = kFirstPauseNs;
    return true;
  }
  next_attempt_ns_ = now_ns + pause_ns_;
  pause_ns_ = std::min(2 * pause_ns_, kMaxPauseNs);
  return false;
}

bool LcmLink::publish(const std::string& channel, std::span<const std::uint8_t> bytes) {
  if (!up()) return false;
  if (lcm_publish(lcm_.get(), channel.c_str(), bytes.data(),
                  static_cast<unsigned int>(bytes.size())) == 0) {
    return true;
  }
  const int cause = errno;
  lcm_.reset();
  lost(cause == ENETUNREACH ? "there is no multicast route any more" : systemReason(cause));
  next_attempt_ns_ = monotonicNs() + pause_ns_;
  return false;
}

void LcmLink::lost(const std::string& reason) {
  if (reported_lost_) return;
  reported_lost_ = true;
  log_.warning("cannot publish to " + url_ + ": " + reason +
               "; poses are computed but not sent, trying again");
}

}  // namespace waymark::daemon
