// Where the map has markers in the frame to come: what detection follows them by.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/detection/search/marker_follower.h"
#include "slam/map/map.h"
#include "slam/tracking/local_markers.h"
#include "slam/tracking/prediction.h"

namespace waymark::slam {

class MarkerExpectation {
 public:
  // Of the neighbourhood's markers and those followed so far, the ones that have a pose and are
  // wholly in front of the camera both where it was and where it is predicted; sorted by id. Empty
  // without a prediction. Valid until the next call.
  [[nodiscard]] std::span<const ExpectedMarker> update(
      const Map& map, const std::optional<Prediction>& prediction, const LocalMarkers& local,
      std::span<const MarkerFollower::Followed> followed);

 private:
  // Reused from frame to frame.
  std::vector<int> ids_;
  std::vector<ExpectedMarker> expected_;
};

}  // namespace waymark::slam
