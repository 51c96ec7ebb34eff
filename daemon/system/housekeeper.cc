#include "daemon/system/housekeeper.h"

#include <algorithm>

#include <sys/eventfd.h>

#include "base/clock.h"

namespace waymark::daemon {

Housekeeper::Housekeeper(FrameQueue& frames, const SlamOutput& slam, TripleBuffer<health_t>& health,
                         const ServiceManager& service, const Log& log, const Options& options)
    : frames_(frames),
      slam_(slam),
      health_(health),
      service_(service),
      log_(log),
      options_(options),
      stop_(eventfd(0, EFD_CLOEXEC)),
      files_({{stop_.get(), POLLIN, 0}}) {}

void Housekeeper::watch(int fd, std::function<void()> serve) {
  files_.push_back({fd, POLLIN, 0});
  servers_.push_back(std::move(serve));
}

void Housekeeper::run() {
  std::int64_t next_tick_ns = monotonicNs();
  while (!stopsWithin(std::chrono::milliseconds(0))) {
    if (monotonicNs() >= next_tick_ns) {
      tick();
      next_tick_ns = monotonicNs() + std::chrono::nanoseconds(options_.tick).count();
    }
    if (waitForFiles(next_tick_ns)) {
      serveAll();
      if (stopsWithin(options_.rest)) break;
    }
  }
  serveAll();
  reportHealth();
}

bool Housekeeper::stopsWithin(std::chrono::milliseconds time) const {
  pollfd stop{stop_.get(), POLLIN, 0};
  return poll(&stop, 1, static_cast<int>(time.count())) > 0;
}

// True when one of the files is readable.
bool Housekeeper::waitForFiles(std::int64_t until_ns) {
  const std::int64_t rest_ms = (until_ns - monotonicNs()) / 1'000'000 + 1;
  const int timeout_ms = static_cast<int>(std::max<std::int64_t>(rest_ms, 0));
  return poll(files_.data(), files_.size(), timeout_ms) > 0;
}

void Housekeeper::serveAll() const {
  for (const auto& serve : servers_) serve();
}

void Housekeeper::requestStop() { eventfd_write(stop_.get(), 1); }

void Housekeeper::tick() {
  frames_.wake();  // a SLAM loop without frames comes round, too
  feedWatchdog(monotonicNs());
  reportHealth();
  serveAll();
}

void Housekeeper::feedWatchdog(std::int64_t now_ns) {
  if (options_.watchdog_ns == 0 || now_ns < next_feeding_ns_) return;
  const bool hangs = slamHangs(now_ns);
  if (!hangs) {
    service_.alive();
    next_feeding_ns_ = now_ns + options_.watchdog_ns / 8;
  } else if (!reported_hanging_) {
    log_.error("the SLAM loop hangs; the watchdog will restart the daemon");
  }
  reported_hanging_ = hangs;
}

bool Housekeeper::slamHangs(std::int64_t now_ns) const {
  // A loop that has come to its end is no loop that hangs: the last map is being saved.
  if (slam_.finished.load(std::memory_order_relaxed)) return false;
  const std::int64_t alive_ns = slam_.alive_ns.load(std::memory_order_relaxed);
  const std::int64_t frame_began_ns = slam_.frame_began_ns.load(std::memory_order_relaxed);
  return now_ns - alive_ns > options_.watchdog_ns / 2 ||
         (frame_began_ns != 0 && now_ns - frame_began_ns > options_.longest_frame_ns);
}

void Housekeeper::reportHealth() {
  const health_t* health = health_.take();
  if (health == nullptr) return;
  if (tap_) tap_(*health);
  const HealthJournal::Changes changes = journal_.changes(*health);
  if (!changes.state.empty()) {
    log_.info(changes.state);
    service_.status(changes.state);
  }
  if (!changes.lens.empty()) log_.info(changes.lens);
  if (!changes.faults.empty()) log_.warning("counted: " + changes.faults);
}

}  // namespace waymark::daemon
