// The housekeeping thread: what is neither a frame nor a message. It tells the service manager that
// the SLAM loop is alive, and the journal what has changed.
#pragma once

#include <chrono>
#include <cstdint>

#include "base/unique_fd.h"
#include "daemon/health_journal.h"
#include "daemon/log.h"
#include "daemon/service_manager.h"
#include "daemon/slam_loop.h"
#include "daemon/triple_buffer.h"

namespace waymark::daemon {

class Housekeeper {
 public:
  struct Options {
    std::chrono::milliseconds tick{100};
    // The service manager's watchdog, nanoseconds; 0: none. It is fed as long as the SLAM loop has
    // come round within half of it.
    std::int64_t watchdog_ns = 0;
  };

  Housekeeper(FrameQueue& frames, const SlamOutput& slam, TripleBuffer<health_t>& health,
              const ServiceManager& service, const Log& log, const Options& options);

  // The thread's body. Returns after requestStop(), having told what was left.
  void run();
  // Any thread.
  void requestStop();

 private:
  void tick();
  void feedWatchdog(std::int64_t now_ns);
  void tellHealth();

  FrameQueue& frames_;
  const SlamOutput& slam_;
  TripleBuffer<health_t>& health_;
  const ServiceManager& service_;
  const Log& log_;
  const Options options_;
  UniqueFd stop_;  // an eventfd
  HealthJournal journal_;
  std::int64_t next_feeding_ns_ = 0;
  bool told_hanging_ = false;
};

}  // namespace waymark::daemon
