// What a keyframe says of its markers when nobody knows where it was itself: its share of the
// normal equations (Eq. 33), the keyframe eliminated. It is kept from one recovery of the marginals
// to the next, as long as what it was made of stays the same.
//
// The equations are linear about one point for each marker, the same for all keyframes: were it
// another one for each, together they would claim to know what they do not (the whole map turned).
// The point follows its marker when that has moved, and then the marker's keyframes are linearized
// anew.
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <vector>

#include "slam/covariance/camera_uncertainty.h"
#include "slam/geometry/transform.h"
#include "slam/map/map.h"

namespace waymark::slam {

// What was linearized holds while marker and camera have moved by less than this, in sides of the
// marker, and turned by less: it changes the views' Jacobians by some thousandths.
inline constexpr double kStillLinear_sides = 0.02;
inline constexpr double kStillLinear_rad = 0.004;
// And while the residuals' sigma, which is in the kernel and the links' weight, is within this
// share.
inline constexpr double kSameSigma = 0.01;

// Whether `now` is within the bounds above of `then`.
[[nodiscard]] bool isStillLinear(const Transform& then, const Transform& now, double side_m);

// Where the equations of a marker are linear.
struct LinearizationPoint {
  Transform T_w_m;
  int revision = 0;  // another one each time the point moves; 0 for no point
};

class LinearizationPoints {
 public:
  // Of a marker that is here now.
  const LinearizationPoint& follow(int marker, const Transform& T_w_m, double size_m);

 private:
  std::map<int, LinearizationPoint> points_;
  int last_revision_ = 0;
};

struct KeyframeInformation {
  struct Marker {
    int id = -1;
    int revision = 0;  // of its point; 0: no unknown, nor fixed; -1: could not be linearized
  };

  // What it was made of. `markers`: all those seen or linked to, by id.
  Transform T_w_c;
  SharedDetections detections;
  std::vector<MarkerLink> links;
  std::vector<Marker> markers;
  Twist twist = Twist::Zero();
  CameraUncertainty::Unknown parameters;  // of the camera
  double residual_sigma = 1.0;
  double smallest_m = 0.0;  // of the markers
  bool held = false;        // its pose is the world's, and not eliminated

  // What came of it. `unknown`: those of the markers whose poses are unknowns, by id; the lower
  // triangle of blocks column by column, rows of the larger id; right sides at the points.
  std::vector<int> unknown;
  std::vector<Matrix6d> blocks;
  std::vector<Vector6d> right;
  // The same where a parameter of the camera is larger by 1: all those of the first unknown marker,
  // then of the next.
  std::vector<Vector6d> by_camera;

  [[nodiscard]] std::size_t bytes() const;
};

// A marker of the equations.
struct LinearizedMarker {
  LinearizationPoint point;
  bool fixed = false;
};
// Null for a marker that is not in the equations.
using MarkerLookup = std::function<const LinearizedMarker*(int id)>;

// What the keyframe names: a start for linearize(), or for isAsBefore().
[[nodiscard]] KeyframeInformation beginInformation(const Keyframe& keyframe, bool held,
                                                   double residual_sigma,
                                                   const CameraUncertainty& camera,
                                                   const MarkerLookup& markers);

// Whether linearizing the keyframe anew would say the same, up to the bounds above.
[[nodiscard]] bool isAsBefore(const KeyframeInformation& information, const Keyframe& keyframe,
                              bool held, double residual_sigma, const CameraUncertainty& camera,
                              const MarkerLookup& markers);

// Of the keyframe as it is now, those of its markers that it named when `information` was begun.
// Precondition: that was with the same markers.
void linearize(const Map& map, const Keyframe& keyframe, const CameraUncertainty& camera,
               const MarkerLookup& markers, KeyframeInformation* information);

// Some 7 kB for a keyframe of six markers (a block of 288 bytes for each pair): 42 MB for 6,000 of
// them. No more than this is kept; keyframes beyond are linearized in each recovery.
inline constexpr std::size_t kMostKeptBytes = 48'000'000;

class KeptInformation {
 public:
  explicit KeptInformation(std::size_t most_bytes = kMostKeptBytes) : most_bytes_(most_bytes) {}

  [[nodiscard]] LinearizationPoints& points() { return points_; }
  // Null where nothing is kept of the keyframe.
  [[nodiscard]] const KeyframeInformation* find(KeyframeId id) const;
  // Kept, unless there is no room: then it is null, and `information` as it was.
  const KeyframeInformation* keep(KeyframeId id, KeyframeInformation* information);
  void forget(KeyframeId id);
  // Those from the first one to before the other are no more.
  void forgetBetween(KeyframeId from, KeyframeId before);
  // So many of those that are kept go. True when none is left.
  bool letGo(int count);
  [[nodiscard]] std::size_t bytes() const { return bytes_; }
  [[nodiscard]] std::size_t size() const { return keyframes_.size(); }
  // How often something was kept.
  [[nodiscard]] std::size_t kept() const { return kept_; }

 private:
  LinearizationPoints points_;
  std::map<KeyframeId, KeyframeInformation> keyframes_;
  std::size_t most_bytes_;
  std::size_t bytes_ = 0;
  std::size_t kept_ = 0;
};

}  // namespace waymark::slam
