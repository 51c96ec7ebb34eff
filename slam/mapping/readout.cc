#include "slam/mapping/readout.h"

#include "slam/optimisation/map_optimiser.h"

namespace waymark::slam {

void Readout::deskew(const CameraModel& camera, const Map& map, const Transform& T_w_c,
                     const Twist& twist, std::vector<MarkerDetection>* detections) const {
  if (seconds_ == 0.0) return;
  for (MarkerDetection& detection : *detections) {
    const MapMarker* marker = map.find(detection.id);
    const auto better =
        deskewed(detection, camera, T_w_c, twist, marker != nullptr ? marker->T_w_m : std::nullopt,
                 markers_.sizeOf(detection.id), seconds_);
    if (better) detection = *better;
  }
}

bool Readout::learn(const CameraModel& camera, const BundleOptions& optimisation, Map* map) {
  const int keyframes = static_cast<int>(map->keyframes().size());
  if (shutter_.readout_s || keyframes < next_keyframes_) return false;
  next_keyframes_ = static_cast<int>(shutter_.growth * keyframes) + 1;
  // While the shutter is not known well, the views that speak loudest of it fit worst.
  BundleOptions ungated = optimisation;
  ungated.view_chi2 = 0.0;
  const auto found =
      estimateReadout(*map, markers_, seconds_, camera, shutter_.most_keyframes, ungated);
  if (!found || !believable(found->readout_s, found->sigma_s, seconds_, shutter_)) return false;
  seconds_ = found->readout_s;
  map->undistortAgain(camera, seconds_);
  (void)optimiseGlobally(map, markers_, ungated);
  return true;
}

}  // namespace waymark::slam
