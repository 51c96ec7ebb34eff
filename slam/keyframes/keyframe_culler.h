// Which keyframes a map goes on without (section 4.6).
#pragma once

#include <unordered_map>
#include <vector>

#include "slam/keyframes/keyframe_policy.h"
#include "slam/map/map.h"

namespace waymark::slam {

class KeyframeCuller {
 public:
  explicit KeyframeCuller(const KeyframeOptions& options) : options_(options) {}

  // For the neighbourhood of a new keyframe: for each marker the N_c keyframes farthest from each
  // other; of its neighbours those that no marker chose are removed. The map's first keyframe (the
  // gauge), the new one and those with links stay. Returns how many went.
  int cull(Map* map, KeyframeId newest);

 private:
  // As it was when the marker's newest view came: optimizations move views by too little to matter.
  struct Choice {
    KeyframeId newest_view = -1;
    std::vector<KeyframeId> views;  // ascending
    KeyframeId looked_at = -1;      // in the culling for this one
  };

  [[nodiscard]] bool chooses(const Map& map, int marker, KeyframeId view, KeyframeId newest);
  [[nodiscard]] bool isWanted(const Map& map, KeyframeId keyframe, KeyframeId newest);

  KeyframeOptions options_;
  std::unordered_map<int, Choice> choices_;  // by marker
};

}  // namespace waymark::slam
