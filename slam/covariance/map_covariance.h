// What the map knows of its own uncertainty, kept up to date as it changes: the markers' marginals,
// recovered again and again in slices, and the covariance of each frame's pose in the world.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "base/task.h"
#include "slam/covariance/camera_uncertainty.h"
#include "slam/covariance/keyframe_information.h"
#include "slam/covariance/marginals.h"
#include "slam/covariance/world_covariance.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"

namespace waymark::slam {

struct MapCovarianceOptions {
  // Off: poses have the covariance relative to the markers in view only, and markers the one given
  // the keyframes.
  bool enabled = true;
  // What a frame may spend on the marginals, in the units of Options::work_per_frame. More follows
  // a growing map sooner; new markers hang rigidly on known ones until then.
  double cost_per_frame = 60.0;
  // A recovery is followed by so many times the frames that it took without one. Less often costs
  // less, and poses use older marginals; more at once and seldom makes these as fresh on the
  // average as half as much in every frame would, for half of the work.
  double rest = 3.0;
  // What is the same in all views of a corner (paper, ink, light, the blur of its edges), in units
  // of the sigma of one view: a marker is never known better than one view with that error would
  // have it. It moves the marker from where it hangs, not the poses that are found from it.
  double repeated_share = 0.35;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// All that it is given at the start must outlive it.
class MapCovariance {
 public:
  // Of a map that is there already; what it says of its markers is believed until more is known.
  // grows: false where the map is only localized in, and stays as it is to the last bit.
  MapCovariance(const MarkerOptions& markers, const MapCovarianceOptions& options,
                const CameraUncertainty& camera, const Map& map, bool grows = true);

  // Poses or views have changed: the marginals are due again.
  void noteChange() { due_ = true; }
  // A slice of the recovery under way, or due; what is done goes into the markers of a map that
  // grows, and then it says so. residual_sigma: of the map's whitened residuals.
  bool work(double residual_sigma, Map* map);
  // All of it at once.
  void recover(double residual_sigma, Map* map);

  // Of a map that nobody needs any more: what is under way goes, and of what is kept so much. True
  // when nothing is left.
  bool letGo(int count) {
    recovery_.reset();
    return kept_.letGo(count);
  }

  // A marker has come to the map with a pose of this covariance in the world: known until the next
  // recovery from that alone.
  void introduce(int marker, const Transform& T_w_c, const Matrix6d& pose_covariance, Map* map);

  // Of a pose that was found from these markers; that of the solution itself where it cannot be
  // told. in_view: poseByCamera() of it.
  [[nodiscard]] Matrix6d inWorld(const PoseSolution& solution, std::span<const KnownMarker> markers,
                                 const PoseGlobalMatrix& in_view) const;
  // What poses near the last frame's, here, have in common that the map does not know, the camera
  // as it is; and how they move, together with the map there, with the camera's parameters.
  [[nodiscard]] Matrix6d sharedAt(const Eigen::Vector3d& p_w) const;
  [[nodiscard]] PoseGlobalMatrix sharedByCamera(const Eigen::Vector3d& p_w) const;
  // The next poses are from this marker: what the map does not know of it is theirs. Precondition:
  // it has a pose.
  void doubtAs(const MapMarker& marker);
  // The same where that is less, here, than what was so far. Whether it was.
  bool doubtIfLess(const MapMarker& marker, const Eigen::Vector3d& p_w);
  // As inWorld(), of the newest frame, but for the camera, which is taken as it is: its doubt holds
  // for the next ones whose markers are all new.
  // What was computed of the frames before is taken where little has changed since.
  [[nodiscard]] Matrix6d follow(const PoseSolution& solution, std::span<const KnownMarker> markers);

 private:
  void adopt(MapMarginals marginals, Map* map);
  [[nodiscard]] Matrix6d repeatedOf(const Map& map, const MapMarker& marker) const;

  const MarkerOptions& markers_;
  const MapCovarianceOptions& options_;
  const CameraUncertainty& camera_;
  bool grows_;
  MapMarginals marginals_;
  PlaceDoubt doubt_;
  KeptPoseCovariance followed_;  // of what the marginals are now, and the doubt was
  bool due_ = false;
  int frames_ = 0;           // that the recovery under way has taken
  int rest_frames_ = 0;      // until the next one may begin
  std::uint64_t epoch_ = 0;  // of the map when the recovery under way began
  KeptInformation kept_;     // from one recovery to the next
  std::optional<SlicedTask<MapMarginals>> recovery_;
};

}  // namespace waymark::slam
