#include "daemon/housekeeper.h"

#include <poll.h>
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
      stop_(eventfd(0, EFD_CLOEXEC)) {}

void Housekeeper::run() {
  pollfd stop{stop_.get(), POLLIN, 0};
  while (poll(&stop, 1, static_cast<int>(options_.tick.count())) <= 0) tick();
  tellHealth();
}

void Housekeeper::requestStop() { eventfd_write(stop_.get(), 1); }

void Housekeeper::tick() {
  frames_.nudge();  // a SLAM loop without frames comes round, too
  feedWatchdog(monotonicNs());
  tellHealth();
}

void Housekeeper::feedWatchdog(std::int64_t now_ns) {
  if (options_.watchdog_ns == 0 || now_ns < next_feeding_ns_) return;
  const std::int64_t alive_ns = slam_.alive_ns.load(std::memory_order_relaxed);
  const bool hangs = now_ns - alive_ns > options_.watchdog_ns / 2;
  if (!hangs) {
    service_.alive();
    next_feeding_ns_ = now_ns + options_.watchdog_ns / 8;
  } else if (!told_hanging_) {
    log_.error("the SLAM loop hangs; the watchdog will restart the daemon");
  }
  told_hanging_ = hangs;
}

void Housekeeper::tellHealth() {
  const health_t* health = health_.take();
  if (health == nullptr) return;
  const HealthJournal::News news = journal_.news(*health);
  if (!news.state.empty()) {
    log_.info(news.state);
    service_.status(news.state);
  }
  if (!news.faults.empty()) log_.warning("counted: " + news.faults);
}

}  // namespace waymark::daemon
