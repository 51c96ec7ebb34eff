// The map W of seed 1, section 3.3: markers, keyframes and who sees what.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/transform.h"
#include "slam/map/picture_print.h"
#include "slam/map/shared_detections.h"

namespace waymark::slam {

// Unique within a map, and ever growing.
using KeyframeId = std::int64_t;

enum class MarkerState {
  kUnresolved,   // seen, but its pose is not known yet (the paper's gamma_m = 0)
  kMapped,       // has a pose
  kQuarantined,  // its views contradict the map or each other; being estimated anew
  kBanned,       // two prints of one id, or one that never stays: not used any more
  kElsewhere,    // another piece of the map knows where it is; its views here connect the two
};

struct MapMarker {
  int id = -1;
  double size_m = 0.0;    // a picture's width
  double height_m = 0.0;  // of a picture; 0: a square
  std::string picture{};  // its name, where it is one (picture_print.h); ids are isPicture() then
  MarkerState state = MarkerState::kUnresolved;
  std::optional<Transform> T_w_m;  // gamma_m; has a value when the state is kMapped, and only then
  // The second pose that explains the views nearly as well; empty once the evidence has decided.
  std::optional<Transform> other_T_w_m;
  // Of (dp, dtheta) of T_w_m, given the keyframes that see it: metres, radians, world frame.
  Matrix6d covariance = Matrix6d::Zero();
  // The same in the world, with what is not known of the keyframes; zero as long as nobody has
  // computed it.
  Matrix6d world_covariance = Matrix6d::Zero();
  std::vector<Transform> former_poses;  // T_w_m before each quarantine

  // Whether state and poses go together; those in a map always do. A second pose needs a first.
  [[nodiscard]] bool isSound() const;
  // Corners in the world, metres. Precondition: T_w_m has a value.
  [[nodiscard]] std::array<Eigen::Vector3d, 4> cornersInWorld() const;
};

// Where a marker is as seen from a keyframe that has no corners of it: carried there, by natural
// features, since it was last in view; or found there as a picture. To the optimizations it is one
// more view of the marker, which no gate leaves out.
struct MarkerLink {
  int marker = -1;
  Transform T_c_m;
  // Of (dp, dtheta) of T_c_m: metres, radians, in the keyframe's camera. Positive definite.
  Matrix6d covariance = Matrix6d::Identity();
};

// A frame kept for optimization, with the markers it sees (Lambda^i, Eq. 13).
struct Keyframe {
  KeyframeId id = -1;
  std::uint64_t sequence = 0;
  std::int64_t monotonic_ns = 0;
  Transform T_w_c;              // inverse of the paper's gamma^i
  SharedDetections detections;  // sorted by id
  // Of the camera in its own frame, metres and radians per second; 0 where nobody needs it.
  Vector6d twist = Vector6d::Zero();
  std::vector<MarkerLink> links{};  // sorted by marker

  // Null when the keyframe does not see the marker.
  [[nodiscard]] const MarkerDetection* find(int marker_id) const;
  // take(id) for each marker that it says something about: those it sees, then those it is linked
  // to.
  template <typename Take>
  void forEachMarker(const Take& take) const {
    for (const MarkerDetection& detection : detections) take(detection.id);
    for (const MarkerLink& link : links) take(link.marker);
  }
};

struct KeyframePose {
  KeyframeId id = -1;
  Transform T_w_c;
};

// A copy shares the corners of its keyframes with the original: it costs some memory for each
// keyframe and marker, and may be read, and let go, by another thread.
class Map {
 public:
  std::string dictionary;
  // Which piece of the map it is: each has a world of its own. Counted from 0, and never used again
  // for another one.
  int piece = 0;

  // Nothing to localize in. Imported maps have markers with poses, but no keyframes.
  [[nodiscard]] bool empty() const;
  [[nodiscard]] const std::map<int, MapMarker>& markers() const { return markers_; }
  // In the order of insertion; the first one fixes the gauge.
  [[nodiscard]] const std::map<KeyframeId, Keyframe>& keyframes() const { return keyframes_; }

  // Null when the marker is unknown.
  [[nodiscard]] const MapMarker* find(int marker_id) const;
  // Null when the marker is unknown or has no pose.
  [[nodiscard]] const MapMarker* findPosed(int marker_id) const;
  // V(m) of Eq. 32: the keyframes that see a marker, oldest first.
  [[nodiscard]] std::span<const KeyframeId> viewsOf(int marker_id) const;
  // How many all of these are.
  [[nodiscard]] std::size_t viewCount() const { return view_count_; }
  // The keyframes that are linked to a marker, in the order of the links.
  [[nodiscard]] std::span<const KeyframeId> linkedFrom(int marker_id) const;
  // G(f) of Eq. 30: the keyframes that share a marker with the given one, itself among them.
  // Precondition: the keyframe exists.
  [[nodiscard]] std::vector<KeyframeId> neighbours(KeyframeId keyframe) const;
  // G_m of Eq. 31: the markers that any of the keyframes sees, sorted.
  [[nodiscard]] std::vector<int> markersSeenFrom(std::span<const KeyframeId> keyframes) const;

  // Adds the marker, without a pose; one that is known already stays as it is.
  const MapMarker& addMarker(int marker_id, double size_m);
  // The same of a picture.
  const MapMarker& addPicture(const PicturePrint& print);
  // A marker as a file or another map has it, in place of what is known of it. False, and nothing
  // is done, when it is not sound.
  [[nodiscard]] bool putMarker(const MapMarker& marker);
  // What becomes of a known marker: its state and its poses change together. Its views stay; links
  // to it go with its pose.
  // It hangs there: mapped.
  void place(int marker_id, const Transform& T_w_m, const std::optional<Transform>& other = {},
             const Matrix6d& covariance = Matrix6d::Zero());
  // Precondition: the marker has a pose.
  void setWorldCovariance(int marker_id, const Matrix6d& covariance) {
    ++changes_;
    markers_.at(marker_id).world_covariance = covariance;
  }
  // Its pose goes to the former ones, where it has one.
  void quarantine(int marker_id);
  // No marker has ever been in quarantine. One that is, or that was banned for its moves, which its
  // former poses tell, is unresolved again.
  void forgetMoves();
  // Its pose goes.
  void ban(int marker_id);
  // Another piece has it, or not any more: then it is unresolved. Precondition: it has no pose
  // here.
  void setElsewhere(int marker_id, bool elsewhere);

  // Its markers must be known. `keyframe.id` is given here, unless it is a larger one than all
  // before it (a map read from a file). Its links to markers that are not in the map are left out.
  KeyframeId addKeyframe(Keyframe keyframe);
  void removeKeyframe(KeyframeId id);
  // Precondition: the keyframe exists.
  void setKeyframePose(KeyframeId id, const Transform& T_w_c) {
    ++changes_;
    keyframes_.at(id).T_w_c = T_w_c;
  }
  // Of those that exist. Precondition: ascending.
  void setKeyframePoses(std::span<const KeyframePose> poses);
  // Precondition: the keyframe exists.
  void setKeyframeTwist(KeyframeId id, const Vector6d& twist) {
    ++changes_;
    keyframes_.at(id).twist = twist;
  }
  // In place of another one between the two. Preconditions: both exist.
  void addLink(KeyframeId id, const MarkerLink& link);
  // One more detection of a keyframe. Preconditions: the keyframe exists and does not see the
  // marker yet; the marker is known.
  void addView(KeyframeId id, const MarkerDetection& detection);
  // Another detection in place of what the keyframe has seen of the marker. Precondition: it has.
  void replaceView(KeyframeId id, const MarkerDetection& detection);
  // The marker's detections leave these keyframes; a keyframe that sees nothing any more stays.
  void removeViews(int marker_id, std::span<const KeyframeId> keyframes);
  // Keyframes and marker stay.
  void removeLinksTo(int marker_id);
  // Moves the whole map into another world: every T_w_x becomes T_v_w * T_w_x. Links are relative,
  // and stay as they are.
  void moveWorld(const Transform& T_v_w);
  // A copy of another map, made piece by piece, goes on as that would: with its epoch, and with ids
  // that were never used.
  void goOnFrom(const Map& map);
  // Counts all changes: as long as it stays the same, the map does.
  [[nodiscard]] std::uint64_t changes() const { return changes_; }
  // Of a map that nobody needs any more, as letting go of a large one takes milliseconds: so many
  // of its keyframes and markers go. True when none is left.
  bool letGo(int count);
  // Counts the changes of all coordinates, or of all corners, at once: what was computed from those
  // of an earlier epoch is of no use any more.
  [[nodiscard]] std::uint64_t epoch() const { return epoch_; }
  void beginEpoch() {
    ++changes_;
    ++epoch_;
  }

 private:
  std::map<int, MapMarker> markers_;
  std::map<KeyframeId, Keyframe> keyframes_;
  std::map<int, std::vector<KeyframeId>> views_;  // by marker; ascending
  std::size_t view_count_ = 0;
  std::map<int, std::vector<KeyframeId>> linked_from_;  // by marker
  KeyframeId next_keyframe_ = 0;
  std::uint64_t epoch_ = 0;
  std::uint64_t changes_ = 0;
};

}  // namespace waymark::slam
