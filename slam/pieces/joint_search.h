// The frames that two pieces of the map were both seen in, located in both one by one: as many in a
// frame's time as its allowance is good for.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "slam/map/map.h"
#include "slam/pieces/piece_joint.h"

namespace waymark::slam {

class JointSearch {
 public:
  // Of the keyframes of either piece that see markers of both, at most max_views, spread over all.
  JointSearch(const Map& a, const Map& b, const PieceOptions& options);

  // Goes on for `work` units, as of Options::work_per_frame; at least one frame. True when all are
  // done. The pieces may have changed since, but must be the same two.
  bool advance(const Map& a, const Map& b, const JointParts& parts, double work);
  // What the frames say.
  [[nodiscard]] const std::vector<JointView>& views() const { return views_; }

 private:
  std::vector<std::pair<int, KeyframeId>> frames_;  // piece and keyframe
  std::size_t next_ = 0;
  std::vector<JointView> views_;
};

}  // namespace waymark::slam
