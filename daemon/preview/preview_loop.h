// The thread that makes small images for people and sends them, by a way out to LCM of its own: no
// pose waits for it. At a low priority, and asleep while nobody asks.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "daemon/health/counter_source.h"
#include "daemon/preview/preview_link.h"
#include "daemon/preview/preview_maker.h"
#include "daemon/publish/lcm_link.h"
#include "daemon/system/log.h"
#include <waymark/preview_t.hpp>

namespace waymark::daemon {

class PreviewLoop {
 public:
  // Precondition: multicastAddress(url) is not empty. The link must outlive it.
  PreviewLoop(PreviewLink& frames, const std::string& url, std::string channel, const Log& log,
              const PreviewOptions& options = {});

  // The thread's body: returns after a stop of the link.
  void run();

  // Any thread. Names begin with "preview.".
  void reportCounters(const CounterSink& sink) const;

 private:
  PreviewLink& frames_;
  const std::string channel_;
  LcmLink out_;
  PreviewMaker maker_;
  preview_t message_{};
  std::vector<std::uint8_t> bytes_;
  std::atomic<std::uint64_t> sent_{0};
  std::atomic<std::uint64_t> unsent_{0};
};

}  // namespace waymark::daemon
