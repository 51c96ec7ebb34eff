#include "tests/multicast.h"

#include <cstdlib>
#include <random>

#include <sched.h>

#include "daemon/publish/lcm_link.h"

namespace waymark::testing {

std::string randomUrl() {
  std::random_device random;
  const unsigned port = 20'000 + random() % 40'000;
  return "udpm://239.255.76.67:" + std::to_string(port) + "?ttl=0";
}

bool ensureMulticastRoute() {
  const auto address = daemon::multicastAddress(randomUrl());
  if (daemon::hasRoute(*address)) return true;
  if (unshare(CLONE_NEWNET) != 0) return false;
  return std::system(
             "ip link set lo up && ip link set lo multicast on && "
             "ip route add 224.0.0.0/4 dev lo") == 0 &&
         daemon::hasRoute(*address);
}

}  // namespace waymark::testing
