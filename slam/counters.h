// Events since the start, each by cause; health and stats.json read them.
#pragma once

#include <cstdint>

namespace waymark::slam {

struct Counters {
  std::uint64_t frames = 0;
  std::uint64_t localized = 0;
  std::uint64_t keyframes_added = 0;
  std::uint64_t relocalizations = 0;
  std::uint64_t loop_closures = 0;        // with a correction of the map
  std::uint64_t loops_without_drift = 0;  // both ends agreed, and were joined as they were
  std::uint64_t loops_refused = 0;        // tested, and found to contradict the map
  std::uint64_t rejected_markers = 0;     // gated out of a pose because they did not fit
  std::uint64_t rejected_poses = 0;       // a pose was computed and rejected
  std::uint64_t clipped_markers = 0;      // a corner at the image's border or beyond
  std::uint64_t doubled_markers = 0;      // one id twice in a frame: both left out
  std::uint64_t flipped_markers = 0;      // the second hypothesis turned out to be the right one
  std::uint64_t quarantined_markers = 0;  // moved, or contradicted the map
  std::uint64_t gated_views = 0;          // too far off for a local optimization
  std::uint64_t refused_markers = 0;      // printed twice, or moved again and again
  std::uint64_t full_scans = 0;           // frames searched as a whole
  std::uint64_t followed_frames = 0;  // frames searched where markers were expected, and in turns
};

// Calls use(name, value) for each, in the order in which health and stats.json list them.
template <typename Use>
void forEachCounter(const Counters& counters, const Use& use) {
  use("frames", counters.frames);
  use("localized", counters.localized);
  use("keyframes_added", counters.keyframes_added);
  use("relocalizations", counters.relocalizations);
  use("loop_closures", counters.loop_closures);
  use("rejected_markers", counters.rejected_markers);
  use("rejected_poses", counters.rejected_poses);
  use("loops_without_drift", counters.loops_without_drift);
  use("loops_refused", counters.loops_refused);
  use("clipped_markers", counters.clipped_markers);
  use("doubled_markers", counters.doubled_markers);
  use("flipped_markers", counters.flipped_markers);
  use("quarantined_markers", counters.quarantined_markers);
  use("gated_views", counters.gated_views);
  use("refused_markers", counters.refused_markers);
  use("full_scans", counters.full_scans);
  use("followed_frames", counters.followed_frames);
  static_assert(sizeof(Counters) == 17 * sizeof(std::uint64_t), "one is missing here");
}

}  // namespace waymark::slam
