// The housekeeping thread: what is neither a frame nor a message. It tells the service manager that
// the SLAM loop is alive, and the journal what has changed; and it serves the control socket and
// whatever else makes a file readable.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include <poll.h>

#include "base/unique_fd.h"
#include "daemon/frames/slam_loop.h"
#include "daemon/frames/triple_buffer.h"
#include "daemon/health/health_journal.h"
#include "daemon/system/log.h"
#include "daemon/system/service_manager.h"

namespace waymark::daemon {

class Housekeeper {
 public:
  struct Options {
    std::chrono::milliseconds tick{100};
    // After files were served. Who makes them readable again and again, such as a crowd of clients,
    // gets a hundred rounds a second, and not the processor.
    std::chrono::milliseconds rest{10};
    // The service manager's watchdog, nanoseconds; 0: none. It is fed as long as the SLAM loop has
    // come round, or got on within a frame, in half of it: a slow frame is no hang.
    std::int64_t watchdog_ns = 0;
    // A frame that takes longer does hang, however it gets on: endless loops make steps, too. Many
    // times what the slowest computer needs for the largest image.
    std::int64_t longest_frame_ns = 120'000'000'000;
  };

  Housekeeper(FrameQueue& frames, const SlamOutput& slam, TripleBuffer<health_t>& health,
              const ServiceManager& service, const Log& log, const Options& options);

  // Calls serve() when this or another file is readable, and at every tick. It must not wait for
  // anything.
  // Before run().
  void watch(int fd, std::function<void()> serve);
  // Health messages go there as well. Before run().
  using HealthTap = std::function<void(const health_t&)>;
  void setTap(HealthTap tap) { tap_ = std::move(tap); }

  // The thread's body. Returns after requestStop(), having told what was left.
  void run();
  // Any thread.
  void requestStop();

 private:
  [[nodiscard]] bool stopsWithin(std::chrono::milliseconds time) const;
  [[nodiscard]] bool waitForFiles(std::int64_t until_ns);
  void serveAll() const;
  void tick();
  void feedWatchdog(std::int64_t now_ns);
  [[nodiscard]] bool slamHangs(std::int64_t now_ns) const;
  void reportHealth();

  FrameQueue& frames_;
  const SlamOutput& slam_;
  TripleBuffer<health_t>& health_;
  const ServiceManager& service_;
  const Log& log_;
  const Options options_;
  UniqueFd stop_;              // an eventfd
  std::vector<pollfd> files_;  // the eventfd first
  std::vector<std::function<void()>> servers_;
  HealthTap tap_;
  HealthJournal journal_;
  std::int64_t next_feeding_ns_ = 0;
  bool reported_hanging_ = false;
};

}  // namespace waymark::daemon
