// Natural markers in the map (seed 2, section 3.1): a picture that was found in frames whose pose
// is known gets a place once several such frames agree on it, by keyframes with a link each to the
// picture; those of later frames from elsewhere make it better. One that is found where it does not
// hang, again and again, has moved.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "slam/frame_time.h"
#include "slam/geometry/twist.h"
#include "slam/late_result.h"
#include "slam/map/map.h"

namespace waymark::slam {

struct PictureMapperOptions {
  // Frames that must agree on where a new picture is. One may be wrong; more delay it.
  std::size_t min_views = 3;
  // Keyframes with a link to a picture, at most. More know its place better, and are never let go.
  std::size_t max_views = 12;
  // From so far apart, as a share of the distance to the picture, or turned by so much, radians,
  // two frames are two views of it: nearer ones have their systematic errors in common.
  double min_baseline_per_distance = 0.1;
  double min_rotation_rad = 0.15;
  // Two places agree when this far apart at most, as chi-square of 6 dimensions: 99.9 %.
  double max_chi2 = 22.5;
  // So many frames in succession, with a pose from markers, that contradict a picture's place: it
  // has moved.
  int moved_after = 5;
  // Carried poses of one stretch share their drift: of such ones one link is made in so long,
  // seconds.
  double carried_pause_s = 2.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// A frame that pictures were looked for in, as it was when it came.
struct AwaitedFrame {
  FrameTime time;
  std::optional<Transform> T_w_c;  // empty: it had no pose
  // Of (dp, dtheta) of T_w_c, relative to the markers or the anchor: metres, radians, world frame.
  Matrix6d covariance = Matrix6d::Zero();
  Twist twist = Twist::Zero();
  std::vector<MarkerDetection> detections;  // that fitted its pose
  int anchor = -1;  // the marker that its pose was carried from; -1: its pose is from markers
};

// What a picture changes in the map.
struct PictureJoint {
  int id = -1;
  bool moved = false;                 // it hangs elsewhere by now: its pose goes
  std::vector<Keyframe> keyframes{};  // oldest first, with their links
  std::optional<Transform> T_w_m{};   // of a picture that is new
  Matrix6d covariance = Matrix6d::Zero();
};

class PictureMapper {
 public:
  // The options must outlive it.
  explicit PictureMapper(const PictureMapperOptions& options) : options_(options) {}

  // A picture seen from a frame. Empty where that changes nothing. Preconditions: the picture is
  // among the map's markers; the result is of that frame.
  [[nodiscard]] std::optional<PictureJoint> offer(const AwaitedFrame& frame, const LateResult& seen,
                                                  const Map& map);
  // All coordinates have changed.
  void moveWorld(const Transform& T_new_old);

 private:
  struct View {
    AwaitedFrame frame{};
    Transform T_c_m{};
    Matrix6d covariance = Matrix6d::Zero();        // of T_c_m
    Transform T_w_m{};                             // what it says of the picture's place,
    Matrix6d place_covariance = Matrix6d::Zero();  // with the frame's own error
  };
  struct Sightings {
    std::vector<View> views;   // from different places, of a picture without one: they agree
    std::size_t agreeing = 0;  // frames, with those from the same place
    int contradictions = 0;    // in succession
    std::optional<std::int64_t> carried_ns;  // of the last link from a carried pose
  };

  [[nodiscard]] static View viewOf(const AwaitedFrame& frame, const LateResult& seen);
  [[nodiscard]] bool agrees(const Transform& a, const Transform& b,
                            const Matrix6d& covariance) const;
  [[nodiscard]] bool isElsewhere(const View& other, const View& view) const;
  [[nodiscard]] std::optional<PictureJoint> placeNew(const View& view, int id, Sightings* sightings,
                                                     const Map& map) const;
  [[nodiscard]] std::optional<PictureJoint> lookAgain(const View& view, const MapMarker& known,
                                                      Sightings* sightings, const Map& map) const;
  [[nodiscard]] static std::optional<Keyframe> keyframeOf(const View& view, int picture,
                                                          double links, const Map& map);

  const PictureMapperOptions& options_;
  std::map<int, Sightings> sightings_;  // by picture
};

}  // namespace waymark::slam
