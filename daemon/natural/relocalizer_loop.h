// The relocalizer's thread (seed 2, section 3.1): looks for natural markers in one frame after the
// other, and takes no more than its share of a processor for it.
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "daemon/health/counter_source.h"
#include "daemon/natural/relocalizer_link.h"
#include "slam/natural/pictures/picture_relocalizer.h"

namespace waymark::daemon {

struct RelocalizerLoopOptions {
  // Of a core: what it has worked, it rests in proportion, so that on the average this is not
  // exceeded. The SLAM loop's own work comes first anyhow, by priority.
  double core_share = 0.5;
  slam::PictureRelocalizerOptions relocalizer;
};

class RelocalizerLoop {
 public:
  // Takes the set, whose ids the link has.
  RelocalizerLoop(std::vector<slam::PosedNaturalMarker> pictures, RelocalizerLink& link,
                  const RelocalizerLoopOptions& options);

  // The thread's body: returns after the link's requestStop().
  void run();

  // Names begin with "relocalizer.".
  void reportCounters(const CounterSink& sink) const;

 private:
  void publishCounts(std::int64_t spent_ns);

  slam::PictureRelocalizer relocalizer_;
  RelocalizerLink& link_;
  const double rest_per_work_;

  // Of the last search and those before it, for the publisher's thread.
  struct Published {
    std::atomic<std::uint64_t> searches{0};
    std::atomic<std::uint64_t> located{0};
    std::atomic<std::uint64_t> not_verified{0};
    std::atomic<std::uint64_t> ambiguous{0};
    std::atomic<std::uint64_t> alike{0};
    std::atomic<std::uint64_t> repeated{0};
    std::atomic<std::int64_t> spent_ns{0};  // processor time
  } published_;
};

}  // namespace waymark::daemon
