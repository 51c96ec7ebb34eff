// A part of the map as a bundle problem, with all it needs, copied or shared: an adjustment in
// slices does not mind what becomes of the map meanwhile. And the way back: what was found, as a
// correction.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/task.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/bundle_adjuster.h"

namespace waymark::slam {

struct Subproblem {
  struct Marker {
    int id = -1;
    std::size_t former_poses = 0;  // how many it had: another number, another place on the wall
  };
  // Its observations point to the detections. Behind the keyframes and markers of the part come
  // the frames and markers that constraints need (constraint_frames.h).
  BundleProblem problem;
  std::vector<KeyframeId> keyframes;         // by camera, ascending
  std::vector<Marker> markers;               // by marker, ascending
  std::vector<SharedDetections> detections;  // of the keyframes
  std::uint64_t epoch = 0;                   // of the map

  // Index of a marker; -1 for one that takes no part.
  [[nodiscard]] int markerIndex(int id) const;
};

// How large a local optimization may be. Where many keyframes see the same markers, all of them
// would take so long that the camera is elsewhere by then.
struct LocalMapOptions {
  int max_keyframes = 40;  // not held; more bend less, and take longer
  int held_views = 12;     // of each marker; more hold it better where many have seen it

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// Who takes part, and who is held where it is.
struct SubproblemMembers {
  struct Role {
    KeyframeId keyframe = -1;
    bool held = false;
  };
  std::vector<Role> keyframes;  // ascending
  std::vector<int> markers;     // ids, ascending; those without a pose take no part
};

// All of it.
[[nodiscard]] SubproblemMembers wholeMap(const Map& map);
// Section 4.7: the keyframes that share a marker with the given one (Eq. 30) and the markers they
// see (Eq. 31); other keyframes that see those markers are held (Eq. 32): as many of each as the
// options allow, those that share the most first. Precondition: it exists.
[[nodiscard]] SubproblemMembers localMap(const Map& map, KeyframeId keyframe,
                                         const LocalMapOptions& options = {});
// So many keyframes, those that the fewest steps from marker to keyframe lead to from the given
// ones; others that see their markers are held.
Task<SubproblemMembers> regionAround(const Map& map, std::vector<KeyframeId> seeds, int keyframes,
                                     Budget* budget);
// The newest keyframes and what they see; the oldest of them is held.
[[nodiscard]] SubproblemMembers newestMap(const Map& map, int keyframes);

// What fixes the world (`markers`: an origin marker, anchors, or else the first keyframe) is held
// too. Keyframes that see none of the markers take no part. Poses are those of the first slice; of
// a part of more than 500 keyframes or markers, those of the slice that comes to them.
Task<Subproblem> buildSubproblem(const Map& map, SubproblemMembers roles,
                                 const MarkerOptions& markers, Budget* budget);

struct MapCorrection {
  struct MarkerPose {
    Subproblem::Marker marker;
    Transform T_w_m;
    Matrix6d covariance = Matrix6d::Zero();
  };
  struct View {
    KeyframeId keyframe = -1;
    int marker = -1;
  };
  std::vector<KeyframePose> keyframes;
  std::vector<MarkerPose> markers;
  std::vector<View> outliers;  // what took no part in the end
  BundleSummary summary;
  std::uint64_t epoch = 0;
};

// Both must outlive the task.
Task<MapCorrection> correctionOf(const Subproblem& part, const BundleAdjuster& adjuster,
                                 Budget* budget);

// Of the map, as long as it hangs where the part was taken out; null for one that hangs elsewhere
// by now, or has no pose.
[[nodiscard]] const MapMarker* findUnmoved(const Map& map, const Subproblem::Marker& marker);
// Puts the poses into the map, where they are still of use: what has left it since, or hangs
// somewhere else by now, stays as it is. False, and nothing is done, when the map's coordinates are
// not those of the part any more.
bool apply(const MapCorrection& correction, Map* map);
// The views that took no part in the end leave the map. Precondition: its keyframes are still
// there.
void removeOutliers(const MapCorrection& correction, Map* map);
// What it will do to the world around a keyframe, T_new_old: nothing where the map has that no
// more.
[[nodiscard]] Transform motionAround(KeyframeId keyframe, const MapCorrection& correction,
                                     const Map& map);
// As apply(); and what it did to the world around a keyframe, T_new_old: the identity where the map
// has it no more. Empty where nothing is done.
std::optional<Transform> applyAround(KeyframeId keyframe, const MapCorrection& correction,
                                     Map* map);

}  // namespace waymark::slam
