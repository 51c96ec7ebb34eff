// Markers that cannot be trusted: printed twice, moved, cut off by the image's border. What is
// noticed here keeps them from pulling the map along.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "slam/counters.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"

namespace waymark::slam {

struct MarkerScreeningOptions {
  // A marker with a corner nearer to the image's border than this is not used, pixels.
  double border_px = 1.0;
  // An id seen twice in one frame this many times is rejected for good. One such frame may be a
  // misread code.
  int doubled_frames = 3;
  // A marker that disagrees with the others in this many of its frames in a row, and for this long,
  // has moved. Smaller notices sooner, larger forgives occlusions.
  int moved_frames = 12;
  std::int64_t moved_ns = 200'000'000;
  // A marker that was quarantined more often than this is rejected for good ...
  int max_moves = 3;
  // ... and at once when it is back where it was before: two prints of one id look like that.
  double same_place_m = 0.05;
  double same_place_rad = 0.3;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

class MarkerScreening {
 public:
  MarkerScreening(const MarkerOptions& markers, const MarkerScreeningOptions& options)
      : markers_(markers), options_(options) {
    constexpr std::size_t kUsual = 64;  // more are seldom in view: steady tracking takes no memory
    disagreements_.reserve(kUsual);
  }

  // The detections that may be used, sorted by id: not ignored, not banned, no duplicates in this
  // frame, not clipped. Valid until the next call.
  [[nodiscard]] std::span<const MarkerDetection> screen(std::span<const MarkerDetection> detections,
                                                        const CameraModel& camera, const Map& map,
                                                        Counters* counters);
  // The same of a frame out of turn: nothing is counted.
  [[nodiscard]] std::vector<MarkerDetection> usable(std::span<const MarkerDetection> detections,
                                                    const CameraModel& camera,
                                                    const Map& map) const {
    std::vector<MarkerDetection> usable;
    (void)sift(detections, camera, map, &usable);
    return usable;
  }
  // Rejects in the map what screen() saw twice too often. True when the map changed.
  bool banDuplicates(Map* map, Counters* counters);

  // Whether a mapped marker fitted the pose that the others gave.
  void record(int marker_id, bool fits, std::int64_t time_ns);
  // Whether a marker of the map has disagreed for long enough to be quarantined.
  [[nodiscard]] bool suspectsMoved(const Map& map) const;
  // The map was corrected: whoever disagreed with it may agree now.
  void forgetDisagreements() { disagreements_.clear(); }
  // What seemed to have moved may have been another lens's doing: it never has, and is no longer
  // rejected for that.
  void forgetMoves(Map* map);
  // Quarantines in the map what has disagreed for long enough: its pose goes, and its views, and it
  // is estimated anew. True when the map changed.
  bool quarantineMoved(Map* map, Counters* counters);
  // A quarantined marker has a pose again: rejected when it is where it was before a move.
  void checkReturned(int marker_id, Map* map, Counters* counters) const;

 private:
  struct LeftOut {
    std::vector<int> doubled;  // ids, sorted
    std::size_t clipped = 0;
  };
  struct Disagreement {
    int marker = -1;
    int frames = 0;
    std::int64_t since_ns = 0;
    std::int64_t until_ns = 0;
  };

  [[nodiscard]] LeftOut sift(std::span<const MarkerDetection> detections, const CameraModel& camera,
                             const Map& map, std::vector<MarkerDetection>* usable) const;
  [[nodiscard]] bool hasMoved(const Disagreement& disagreement, const Map& map) const;

  MarkerOptions markers_;
  MarkerScreeningOptions options_;
  std::vector<MarkerDetection> usable_;      // of the last frame
  std::vector<Disagreement> disagreements_;  // by marker, ascending; only those that go on
  std::map<int, int> doubled_;               // frames by id
};

}  // namespace waymark::slam
