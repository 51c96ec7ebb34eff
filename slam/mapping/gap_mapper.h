// Markers that come into view while natural features carry the pose (seed 2, section 3.3): they
// join the map with what was carried. A marker without a pose in the map is looked at from several
// carried poses until these decide between its two and know its place; then they become keyframes,
// each with a link to the marker that the carried poses are relative to. Where no pose of the
// marker explains them all, what was carried is at odds with itself (a scale that has drifted,
// say): the one view that tells most by itself becomes a keyframe then.
//
// How a marker is turned hardly shows from where it comes into view, and how the camera is turned
// the features know from before: the camera's nearer views of the marker get such a link, too, for
// as long as features are followed on.
//
// The poses of a stretch share their drift: n links of one stretch have n times the covariance, so
// that together they say what one of them knows.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slam/frame_time.h"
#include "slam/geometry/twist.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/marker_pose/marker_resolver.h"
#include "slam/marker_pose/square_pose.h"

namespace waymark::slam {

struct GapMapperOptions {
  // From so far apart, as a share of the distance to the marker, two carried frames are two views
  // of it: nearer ones say the same once more.
  double min_baseline_per_distance = 0.04;
  // Views of a marker after which it joins the map as soon as its pose is decided. Before, it joins
  // when it goes out of sight. More know its place better; over more of them the carried poses
  // drift, and the frames until then are bridged.
  std::size_t views = 6;
  // Links from nearer views of a marker that has joined, each from at most this share of the
  // distance of the one before it. How much a view tells of how the marker is turned grows with the
  // third power of its size.
  std::size_t nearer_views = 3;
  double nearer_share = 0.7;
  // So long, seconds, a marker has not been seen when it is out of sight.
  double out_of_sight_s = 0.2;
  // Views that contradict each other place a marker by the clearest of them only where carried
  // poses may be to blame: where none has the marker further from there than so many standard
  // deviations of what is carried. Else it is the square that is not what it seems: of another
  // size, a photograph that reads as a marker, or one that moves.
  double most_carried_sigmas = 5.0;
  // Views that are further apart in time than this, seconds, are not of one stretch.
  double max_pause_s = 1.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// A frame whose pose was carried by natural features.
struct CarriedFrame {
  FrameTime time;
  std::span<const MarkerDetection> detections;  // as at the middle row's time
  Transform T_w_c;
  // Of (dp, dtheta) of T_w_c, relative to the anchor: metres, radians, world frame.
  Matrix6d covariance = Matrix6d::Zero();
  Twist twist = Twist::Zero();
  int anchor = -1;  // the marker that the pose is relative to
};

// What takes a marker into the map.
struct GapJoint {
  struct Marker {
    int id = -1;
    Transform T_w_m;
    std::optional<Transform> other_T_w_m;
  };
  std::vector<Keyframe> keyframes;  // oldest first, with their links
  Marker marker;
};

class GapMapper {
 public:
  // focal_px: for the ambiguity of squares. The options must outlive it.
  GapMapper(const MarkerOptions& markers, double focal_px, const MarkerResolverOptions& resolver,
            const GapMapperOptions& options)
      : markers_(markers), focal_px_(focal_px), resolver_(resolver), options_(options) {}

  // A carried frame; what it decides, one marker at a time. Empty as long as no new marker's pose
  // is decided, or where the anchor has no pose any more. residual_sigma: of the map's whitened
  // residuals.
  [[nodiscard]] std::optional<GapJoint> offer(const CarriedFrame& frame, const Map& map,
                                              double residual_sigma);
  // A bridge has ended at markers that the map knows: the keyframe that ties them to what it began
  // from. Empty where the stretch has been told of already, by a marker that it gave to the map,
  // and where the anchor itself is in view again.
  [[nodiscard]] std::optional<Keyframe> arrive(const CarriedFrame& frame, const Map& map) const;
  // A frame with a pose from markers, while features that were followed through the gap before a
  // joint still are: the keyframe that ties a nearer view of that joint's marker to the anchor, if
  // this is one. frame.T_w_c, covariance: as the features and the markers in view have them by now;
  // of the covariance that is used which the gap ended with, and what has changed since.
  [[nodiscard]] std::optional<Keyframe> comeNearer(const CarriedFrame& frame, const Map& map);
  // Those features are not followed any more.
  void endNearing() { nearing_.reset(); }
  // The stretch is over: what was seen in it does not belong to the next one.
  void leave() {
    sightings_.clear();
    has_joined_ = false;
  }

 private:
  struct View {
    MarkerDetection detection;
    FrameTime time;
    Transform T_w_c;
    Matrix6d covariance = Matrix6d::Zero();
    Twist twist = Twist::Zero();
  };
  struct Sighting {
    std::vector<View> views;  // oldest first
    int anchor = -1;
    std::int64_t last_seen_ns = 0;
    bool undecided = false;  // these views say too little: others have to come
  };
  // A marker that has joined, and the last view of it with a link.
  struct Nearing {
    int marker = -1;
    int anchor = -1;
    std::size_t joined = 0;  // keyframes
    double distance_m = 0.0;
    std::size_t left = 0;  // links to come
    Eigen::Vector3d p_anchor_c = Eigen::Vector3d::Zero();
    Matrix6d covariance = Matrix6d::Zero();  // in the anchor's axes
  };
  // The new markers among the detections, from here.
  void look(const CarriedFrame& frame, const Map& map);
  [[nodiscard]] double distanceTo(const MarkerDetection& detection) const;
  void noteJoint(const GapJoint& joint, const View& last, const MapMarker& anchor);
  [[nodiscard]] bool isAnotherView(const View& last, const MarkerDetection& detection,
                                   const Transform& T_w_c) const;
  [[nodiscard]] std::optional<GapJoint> decide(const Sighting& sighting, const MapMarker& anchor,
                                               double residual_sigma) const;
  // Where no pose of the marker explains all views, but each view has one.
  [[nodiscard]] std::optional<GapJoint> decideAlone(const Sighting& sighting,
                                                    const MapMarker& anchor) const;
  // What one view, without the others, says.
  struct LoneView {
    const View* view = nullptr;
    SquarePose pose;

    // Of the marker, world frame.
    [[nodiscard]] Eigen::Vector3d place() const { return view->T_w_c * pose.T_c_m[0].p; }
    // Of that, what is due to the camera's carried pose.
    [[nodiscard]] Eigen::Matrix3d carriedCovariance() const;
  };
  [[nodiscard]] std::vector<LoneView> loneViews(const Sighting& sighting) const;
  [[nodiscard]] bool explainedByCarriedPoses(const LoneView& a, const LoneView& b) const;
  // joined: keyframes that the marker joins with, which have the stretch's drift in common with
  // each other and with the nearer ones to come.
  [[nodiscard]] std::optional<Keyframe> keyframeOf(const View& view, const MapMarker& anchor,
                                                   std::size_t joined) const;

  const MarkerOptions& markers_;
  double focal_px_;
  const MarkerResolverOptions& resolver_;
  const GapMapperOptions& options_;
  std::map<int, Sighting> sightings_;  // by marker
  bool has_joined_ = false;            // a marker, in this stretch
  std::optional<Nearing> nearing_;     // the last joint's
};

// A marker as seen from a carried frame that does not show it. Empty where the covariance is none.
[[nodiscard]] std::optional<MarkerLink> linkTo(int marker, const Transform& T_w_m,
                                               const Transform& T_w_c, const Matrix6d& covariance);

}  // namespace waymark::slam
