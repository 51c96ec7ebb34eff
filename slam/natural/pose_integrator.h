// Where a frame's pose comes from when its markers give none (seed 2, section 3.3): from the filter
// of natural features, which follows the markers' poses while there are any and carries the pose
// when there are none; for a moment, from its motion alone. No threads, no clocks; deterministic.
//
// A frame is either follow(), with its pose from markers, or bridge(), without one; then await(),
// where somebody else looks at it, too. What that finds, late() applies at the frame's own time
// (section 3.2): the filter keeps the cameras of awaited frames in its state.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/image_view.h"
#include "slam/camera_pose/known_marker.h"
#include "slam/counters.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/picture_print.h"
#include "slam/natural/filter/visual_filter.h"
#include "slam/natural/start_limits.h"
#include "slam/natural/unscaled_way.h"
#include "slam/pose_estimate.h"

namespace waymark::slam {

struct PoseIntegratorOptions {
  // Features are followed as soon as a frame has no more markers than this, and no longer once
  // there have been more for so long, seconds. More markers are ready for a gap that comes at once,
  // and cost a filter's time where there is no gap to come.
  int max_markers = 3;
  double idle_after_s = 0.5;
  // A frame in which so many features were believed has the filter's pose. More is surer of each
  // frame, and has gaps where there is little texture.
  int min_features = 6;
  // For how long motion alone is a pose, seconds, after the last frame that was seen by features or
  // markers: a hand-held camera goes elsewhere soon.
  double max_prediction_s = 0.2;
  // Without a frame for so long, seconds, the filter is given up: the motion says nothing any more.
  double max_pause_s = 1.0;
  // A pose that is less certain than this at three standard deviations, metres and radians (ten
  // degrees), is none: better lost than lying.
  double max_error_m = 0.5;
  double max_error_rad = 0.1745;
  // What is told of a way whose scale is hardly known.
  UnscaledWayOptions unscaled_way;
  // So long, seconds, features are looked for where nothing is seen: in the dark, or behind what is
  // in the way. Then the filter is given up.
  double max_blind_s = 2.0;
  // A pose from markers that is further from the filter's than this contradicts it, as chi-square
  // of 6 dimensions: once in 1,000 frames by chance.
  double max_innovation_chi2 = 22.5;
  // So many frames in succession whose markers contradict the filter, or its features, are
  // believed, and it starts anew with them. One may be a marker that was moved, or misread.
  int witnesses = 3;
  // How well a pose is known that the filter starts from before it has seen its markers itself:
  // standard deviations, metres and radians.
  double start_sigma_m = 0.02;
  double start_sigma_rad = 0.02;
  // A filter without a place in the world knows no scale either: what is in view is taken to be as
  // far away as the first picture. By how much that may be wrong, as a share, until two pictures'
  // views tell, or the pictures after it.
  double adrift_scale_sigma = 0.7;
  // It begins at a picture as soon as the camera's way since the picture's view is known to this
  // share of the distance to it. More begins sooner where the camera moves, and with a scale that
  // is known less.
  double max_start_error = 0.03;
  // Where in the image a marker or picture must be for it to begin.
  StartLimits start;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct NaturalOptions {
  // Off: a frame without markers has no pose, and nothing of this costs anything.
  bool enabled = true;
  // The natural markers there are; none, and nobody looks for any.
  std::vector<PicturePrint> prints;
  VisualFilterOptions filter;
  PoseIntegratorOptions integrator;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// Whether the filter may begin at a frame's markers, where there is none.
enum class Beginning : std::uint8_t {
  kAllowed,
  kAmbiguous,  // the pose is one of two that nothing has decided between
  kOutside,    // no marker is where in the image the options want one
};

enum class LateOutcome : std::uint8_t {
  kUsed,     // agrees, and is part of the pose now
  kKnown,    // the place is known better than that
  kRefused,  // contradicts what is known
  kStarted,  // the filter goes on from there: it had no place in the world, or a wrong one
  kNoted,    // the same, but how far the camera has gone since is not known yet
  kOpen,     // which of its two poses it is is open, or what is known speaks for the other one
  kOutside,  // the filter does not begin at it, for where it is in the image
  kUnknown,  // nobody follows features since that frame
};

// Where the camera of an earlier frame was, as a picture says.
struct LateFix {
  std::uint64_t frame = 0;
  Transform T_w_c;
  // Of (dp, dtheta), relative to what the pose is from.
  Matrix6d covariance = Matrix6d::Zero();
};

// What a picture says of an earlier frame.
struct LatePose {
  LateFix fix;
  // The other pose that the picture's plane leaves open, of the same frame.
  std::optional<LateFix> other;
  // The picture itself has decided between them.
  bool decided = true;
  // The filter may begin at it: it is within the options' limits.
  bool begins = true;
};

class PoseIntegrator {
 public:
  // All that it is given must outlive it.
  PoseIntegrator(const NaturalOptions& options, const CameraModel& camera, Counters* counters);

  // As VisualFilter's.
  void setReadout(double readout_s) {
    if (filter_) filter_->setReadout(readout_s);
  }

  // A frame with a pose from these markers, all of which fit it. image: of the camera's size, or
  // empty. False while the markers contradict a filter that the last pose was from, alone or
  // fused(): then the frame is to be bridged.
  [[nodiscard]] bool follow(std::int64_t time_ns, const ImageView& image, const PoseEstimate& pose,
                            Beginning beginning, std::span<const KnownMarker> markers);
  // Of the last frame, where it was follow()ed: its pose from features and markers together, in
  // place of the markers' alone. Empty where the filter has only begun, or knows no better, and
  // with more markers than features are followed for.
  [[nodiscard]] const std::optional<PoseEstimate>& fused() const { return fused_; }
  // Of the last frame, where it was follow()ed right after a bridge: where features alone had the
  // camera in it, as of what the bridge began from.
  [[nodiscard]] const std::optional<FilteredPose>& arrival() const { return arrival_; }
  // Of the last frame, where it was follow()ed: where features that were followed through a gap,
  // and have been ever since, have the camera together with the markers in view.
  [[nodiscard]] std::optional<FilteredPose> carriedOn() const;
  // A frame without one; where the camera is, its covariances relative to the markers it came from.
  // Empty where neither features nor motion say. unplaced: markers in view that the map has no
  // place for.
  [[nodiscard]] std::optional<PoseEstimate> bridge(std::int64_t time_ns, const ImageView& image,
                                                   std::span<const UnplacedMarker> unplaced = {});
  // Of the last bridge(): there was a pose, less certain than the options allow.
  [[nodiscard]] bool tooUncertain() const { return too_uncertain_; }

  // After follow() or bridge(): the frame's camera may be spoken of later. Where nothing is
  // followed and the frame has no pose, features are followed from here on, adrift: without a place
  // in the world until late() tells one.
  void await(std::uint64_t frame, std::int64_t time_ns, const ImageView& image, bool has_pose);
  // Before follow() or bridge() of a frame: where the camera of an awaited one was. points_w: of a
  // surface there, that new features may begin at, their places being known.
  LateOutcome late(const LatePose& pose, std::span<const Eigen::Vector3d> points_w);

  [[nodiscard]] bool adrift() const { return adrift_; }

  // The world's coordinates have changed.
  void moveWorld(const Transform& T_new_old);
  // All that is followed is forgotten.
  void giveUp();

 private:
  [[nodiscard]] bool running() const { return filter_ && filter_->running(); }
  // The features seen in it, if any; nullopt where they are given up.
  [[nodiscard]] std::optional<VisualUpdate> look(std::int64_t time_ns, const ImageView& image,
                                                 std::span<const UnplacedMarker> unplaced);
  using Fix = LateFix;
  // Of a filter that has a place. kRefused: it contradicts a picture, which may be wrong itself.
  [[nodiscard]] LateOutcome weigh(const LatePose& pose);
  [[nodiscard]] LateOutcome use(const Fix& fix);
  // Contradicted by one more picture: whether that has been enough of them that agree, or so many
  // that it does not matter.
  [[nodiscard]] bool isOutvoted(const Fix& fix);
  // Whether the camera has turned from one fix to the other as the filter says, whatever its scale:
  // not so where one of them is the other pose of a plane.
  [[nodiscard]] bool turnedAlike(const Fix& a, const Eigen::Matrix3d& a_R_w_c, const Fix& b,
                                 const Eigen::Matrix3d& b_R_w_c) const;
  // Metres for one of the filter's own, from the way between two fixes, and its standard deviation
  // as a share.
  struct Scale {
    double metres = 1.0;
    double sigma = 1.0;
  };
  [[nodiscard]] Scale scaleOf(const Fix& fix) const;
  // Where the camera is by now, and how little is known of its way since the fix, metres: what the
  // filter has seen of it is of no known scale.
  struct Carried {
    FilteredPose pose;
    Scale scale;
    double doubt_m = 0.0;
  };
  [[nodiscard]] std::optional<Carried> carriedFrom(const Fix& fix) const;
  // While adrift: as one view of a picture and a guessed scale say, which is what it is uncertain
  // by.
  [[nodiscard]] std::optional<FilteredPose> placedByFirstFix() const;
  // The filter goes on from a fix, with the features there are; then also with points_w.
  void begin(const Fix& fix, const Scale& scale, std::span<const Eigen::Vector3d> points_w);
  // Features whose places are known, as far as the camera's is: they tell the scale.
  void addKnownPoints(const ImageView& image);
  // Until another fix tells the scale: the place is this one's.
  void note(const Fix& fix);
  // After a frame with that pose from markers.
  [[nodiscard]] std::optional<PoseEstimate> fusedPose(const PoseEstimate& of_markers,
                                                      const VisualUpdate& update) const;
  // After a frame with markers: a filter that refuses all of them, frame after frame, or whose
  // features are not where they should be from there, has gone astray, even where what it says of
  // itself does not exclude it.
  void giveUpIfAtOdds(const VisualUpdate& update);
  // To the frame's time; gives up after a pause.
  void advance(std::int64_t time_ns);
  void start(std::int64_t time_ns, const PoseEstimate& pose, bool assumes_scale = false);
  // Enough markers for so long that there is no gap to come.
  [[nodiscard]] bool isIdle(std::int64_t time_ns, std::size_t markers);
  [[nodiscard]] bool contradicts(const PoseEstimate& pose) const;
  [[nodiscard]] bool isTooUncertain(const FilteredPose& pose) const;
  // The filter's, with what its covariance leaves out.
  [[nodiscard]] FilteredPose filteredPose() const;

  const NaturalOptions& options_;
  const CameraModel& camera_;
  Counters* counters_;
  std::optional<VisualFilter> filter_;
  std::optional<PoseEstimate> fused_;
  std::optional<FilteredPose> arrival_;
  std::int64_t time_ns_ = 0;         // of the filter
  std::int64_t few_markers_ns_ = 0;  // the last frame with at most max_markers
  std::int64_t last_seen_ns_ = 0;    // the last frame that markers or features saw
  bool bridging_ = false;            // the last frame's pose was from features
  bool carried_on_ = false;          // the features' have been once, and they are still followed
  bool too_uncertain_ = false;
  int contradictions_ = 0;               // frames in succession
  int at_odds_ = 0;                      // the same, of giveUpIfAtOdds()
  bool adrift_ = false;                  // the filter has no place in the world yet
  std::optional<Fix> first_fix_;         // while adrift
  std::optional<double> guessed_scale_;  // while adrift: metres for one of the filter's own
  int late_refusals_ = 0;                // in succession, without a marker in between, that agree
  int contradicted_ = 0;                 // all of them
  std::optional<Fix> first_refused_;     // of these
  std::vector<Eigen::Vector3d> known_points_w_;  // that new features are to begin at
  // While a picture contradicts the filter, and nothing has decided between them: how far they are
  // apart, squared. It is part of the pose's covariance.
  Matrix6d contradiction_ = Matrix6d::Zero();
  UnscaledWay unscaled_way_;
  double ambiguity_ratio_ = 0.0;  // of the last pose from markers
};

}  // namespace waymark::slam
