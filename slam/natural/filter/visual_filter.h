// A camera's pose from frame to frame by natural features: where fiducial markers are out of view,
// it goes on from what was triangulated while they were in view, and says how well (seed 2,
// sections 3.2 and 3.3; Davison's active search). No threads, no files, deterministic; it takes no
// memory once it runs.
//
// A frame: predict(), then update() with its image and the markers in it. Scale comes from markers:
// a filter that is started without any is as good as its start says, and its scale stays what it
// assumed of the first depths.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/image_view.h"
#include "slam/camera_pose/known_marker.h"
#include "slam/detection/search/reduced_image.h"
#include "slam/geometry/camera_model.h"
#include "slam/natural/filter/corner_finder.h"
#include "slam/natural/filter/feature_filter.h"
#include "slam/natural/filter/feature_search.h"
#include "slam/natural/filter/patch.h"
#include "slam/natural/filter/point_memory.h"
#include "slam/natural/filter/surface.h"

namespace waymark::slam {

struct FeatureManagementOptions {
  // How well a new feature's patch must say where it is, pixels, for the camera's noise. Larger
  // takes poorer texture.
  double max_sigma_px = 0.12;
  // New features come in lots of at least so many, as each lot keeps a camera in the state.
  int least_lot = 5;
  // Frames that a new feature is only looked at (FeatureMatch::on_trial).
  int trial_frames = 8;
  // As long as so many others are there to be believed; else the oldest of those on trial are. More
  // measures more when features are few, and lets in what moves: with 12, twelve of a moving poster
  // took over from eight of the room.
  int believed_without_trial = 6;
  // So many features refused in one frame, each for one of the first times: things move in view, or
  // stand in front of each other. In three frames of a thousand of rooms where nothing moves.
  int wary_after_refusals = 4;
  // From then on for so long the trials of new features take longer, seconds: the beginning of a
  // motion looks like another depth, which half a second tells apart. Longer leaves fewer features
  // to go by.
  double wary_s = 2.0;
  double wary_trial_s = 0.8;
  // A feature is dropped after so many frames in which it should have been found and was not.
  int max_failures = 8;
  // ... and after so many outside the image.
  int max_frames_outside = 10;
  // A frame in which less than this share of the features is found says nothing about them: it was
  // dark, or blurred, or something was in the way of all of them. After it, less than this share
  // says nothing about the camera either: where it may be far from what is expected, some find
  // something that looks like them.
  double blind_share = 0.25;
  // Where nothing is known of depth: that of a room, metres.
  double first_depth_m = 2.0;
  // ... and the sigma of its inverse, as a share: two of them reach from half of it to infinity
  // (Civera et al. 2008). With more an update is far from linear, and what is a step aside is taken
  // for a turn.
  double first_depth_sigma_ratio = 0.5;
  // The same where there are markers in view, which features may be as far away as. With 3 a start
  // beside one small marker in a fast turn took the turn for depths.
  double marker_depth_sigma_ratio = 2.0;
  // Sigma of a new feature's inverse depth, in units of that which its neighbours suggest. What
  // they suggest is no measurement: little of it is enough to bend the scale where hardly anything
  // moves sideways (along a corridor, 0.5 let it drift by a fifth in ten metres, at random).
  double depth_sigma_ratio = 3.0;
  // Half sizes of the search ellipses in standard deviations, and at most in pixels of the image.
  double search_sigmas = 3.0;
  double max_search_px = 40.0;
  // For how long a match's systematic error (PatchOptions) stays the same, seconds: more images in
  // that time do not average it away.
  double systematic_s = 0.15;
  // Points that have gone out of view are remembered, from so many cameras, so many of each; none,
  // and nothing is. More take a few kilobytes each.
  int remembered_views = 16;
  int remembered_points_per_view = 12;
  // They are looked for when they come back into view, as soon as the camera's place is known so
  // many times worse than where they were seen from, as variances. Less brings them back also where
  // they say nothing new.
  double recalled_when_worse = 2.0;
  // Surfaces that are estimated anew in a frame. More follow sooner, for a few microseconds each.
  int surfaces_per_frame = 6;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct VisualFilterOptions {
  FeatureFilterOptions filter;
  PatchOptions patches;
  FeatureManagementOptions features;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct FilteredPose {
  Transform T_w_c;
  // Of (dp, dtheta) as Transform::retract, metres and radians in the world frame.
  Matrix6d covariance = Matrix6d::Zero();
  // Of the camera in its own frame, metres and radians per second.
  Vector6d twist = Vector6d::Zero();
};

// What became of a frame.
struct VisualUpdate {
  MarkerOutcome markers;
  int expected = 0;  // features that should have been in view
  int found = 0;     // of these, whose patch was found
  int believed = 0;  // of these, that went into the pose
  int on_trial = 0;  // of those expected
  int added = 0;
  int dropped = 0;
  int recalled = 0;     // points that were remembered
  bool blind = false;   // too few found to say anything about the others
  bool wary = false;    // things move in view, or have lately
  double rms_px = 0.0;  // innovations of those believed
};

class VisualFilter {
 public:
  // Takes all the memory it needs, but for images, whose size the first one tells.
  explicit VisualFilter(const VisualFilterOptions& options);

  // From here, with nothing else known. covariance: of (dp, dtheta); a wide one where the markers
  // that the pose is from are given to update() as well.
  // assumes_scale: where no marker tells the scale, it is that of the first depths by definition,
  // and who asks for poses knows; else it is in doubt as they are.
  void reinitialize(const Transform& T_w_c, const Matrix6d& covariance, bool assumes_scale = false);
  // Without a pose, as at the start.
  void reset() { running_ = false; }
  [[nodiscard]] bool running() const { return running_; }

  // A rolling shutter, seconds from first to last row: features are taken as at the middle row's
  // time, as the markers given to update() have to be. 0 for none.
  void setReadout(double readout_s) { readout_s_ = readout_s; }

  // Precondition of these: running().
  void predict(double dt_s);
  // image: of the camera's size; empty for none. markers: those in view that the map knows;
  // unplaced: others.
  VisualUpdate update(const ImageView& image, const CameraModel& camera,
                      std::span<const KnownMarker> markers,
                      std::span<const UnplacedMarker> unplaced = {});
  [[nodiscard]] FilteredPose pose() const;

  // Points whose inverse depth is known (the corners of a printed picture): features from the
  // start. Their places are known as well as the camera's own.
  struct KnownPoint {
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    double rho = 0.0;  // 1 / metres along the optical axis
    double rho_sigma = 0.0;
  };
  // In the image of the last update(), or of the one about to follow reinitialize(). How many found
  // a place.
  int addKnownPoints(const ImageView& image, const CameraModel& camera,
                     std::span<const KnownPoint> points);

  // The world's coordinates have changed.
  void moveWorld(const Transform& T_new_old);
  // What is remembered is not where it was: the world itself has turned out to be another.
  void forgetPoints() { memory_.clear(); }

  // Poses found elsewhere, of this frame and of earlier ones: see FeatureFilter.
  [[nodiscard]] FeatureFilter& filter() { return filter_; }
  [[nodiscard]] const FeatureFilter& filter() const { return filter_; }

  // The features in use, where they were expected in the last frame, for pictures, tests and
  // measurements.
  struct Shown {
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    bool found = false;
    bool believed = false;
    int feature = -1;                                 // its place in the state
    Eigen::Vector2d match = Eigen::Vector2d::Zero();  // where it was found
    double sigma_px = 0.0;  // what is said of the match's error in one frame, a coordinate's
    double stretch = 0.0;   // of its patch against the anchor's image: 0 where it looks the same
  };
  [[nodiscard]] std::span<const Shown> shown() const { return shown_; }
  // Frames in which a feature has been looked for; 0 of one that is new.
  [[nodiscard]] int ageOf(int feature) const {
    return features_[static_cast<std::size_t>(feature)].age;
  }
  // surfaceGradient that a feature's patch is warped with.
  [[nodiscard]] const Eigen::Vector2d& surfaceOf(int feature) const {
    return features_[static_cast<std::size_t>(feature)].look.surface;
  }
  // For measurements: how it lies in truth. It is not estimated any more then.
  void tellSurface(int feature, const Eigen::Vector2d& surface) {
    features_[static_cast<std::size_t>(feature)].look.surface = surface;
    features_[static_cast<std::size_t>(feature)].surface_is_told = true;
  }

 private:
  // What is kept of a feature beside the filter's state.
  struct Feature {
    FeatureLook look;
    bool surface_is_told = false;
    int age = 0;
    bool passed = false;  // its trial
    int failures = 0;     // in succession
    int outside = 0;      // frames in succession
  };
  // What a rolling shutter does to a feature's place, which comes late in the image, or early.
  // Normalized coordinates or pixels.
  struct Skew {
    Eigen::Vector2d shift = Eigen::Vector2d::Zero();       // from where it should be
    Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // what the motion leaves open
  };
  // A feature that should be in view.
  struct Candidate {
    int feature = -1;
    ExpectedFeature expected;  // where the image shows it
    Skew skew;                 // pixels, pixels^2
    bool on_trial = false;
    bool found = false;
    bool believed = false;
    double stretch = 0.0;  // of its patch, where it was found
  };

  // Normalized, of a point in the camera frame times its inverse depth, which that row shows.
  [[nodiscard]] Skew skewOf(const CameraModel& camera, double row_px, const Eigen::Vector3d& y,
                            double rho) const;
  void expectSkewed(const CameraModel& camera, Candidate* candidate) const;
  void lookForFeatures(const CameraModel& camera, VisualUpdate* result);
  void findMatches();
  // Frames that a feature is on trial, as things are.
  [[nodiscard]] int trialFrames() const;
  // Where too few matches are beyond their trial, the oldest others are, too.
  void endTrialsOfOldest();
  // How many matches have to agree to be believed.
  [[nodiscard]] int leastConsensus() const;
  void noteRefusals();
  void expectFeatures(const CameraModel& camera);
  [[nodiscard]] FeatureMatch matchOf(const Candidate& candidate, const FoundFeature& found) const;
  // How much larger a match's systematic error is as white noise that averages as slowly as one
  // that lasts for systematic_s.
  [[nodiscard]] double systematicFrames() const;
  void judge(VisualUpdate* result);
  void drop(int feature);
  void dropHopeless(VisualUpdate* result);
  void remember(int feature);
  // Points that come back into view are features again.
  void recallPoints(const CameraModel& camera, VisualUpdate* result);
  // Of one view, which has a part of what is known in common with so many; how many.
  int recall(const CameraModel& camera, int sharing, RememberedView* view);
  [[nodiscard]] int pointsInView(const CameraModel& camera, const RememberedView& view) const;
  [[nodiscard]] bool isInView(const CameraModel& camera, const RememberedView& view,
                              const RememberedPoint& point) const;
  // The youngest features go until there is room for so many.
  void makeRoomFor(int points);
  void estimateSurfaces();
  void addFeatures(const CameraModel& camera, VisualUpdate* result);
  // The corners of the image's empty parts, the best first.
  void findCorners();
  bool makeRoomForAnchor();
  // A feature to be: what is seen of it in the image at hand.
  struct NewFeature {
    Feature feature;
    Eigen::Vector2d uv = Eigen::Vector2d::Zero();  // as at the middle row's time
    Eigen::Matrix2d uv_covariance = Eigen::Matrix2d::Zero();
  };
  [[nodiscard]] std::optional<NewFeature> cutFeature(const CameraModel& camera,
                                                     const Eigen::Vector2d& pixel, double rho,
                                                     double max_sigma_px) const;
  // Of what new features are likely to be on.
  [[nodiscard]] double likelyDepth_m() const {
    return marker_depth_m_ > 0.0 ? marker_depth_m_ : options_.features.first_depth_m;
  }
  // Its place in the state, as deep as its surroundings are likely to be; -1 when there is none.
  // first: of those added in this frame, -1 for the first one itself.
  [[nodiscard]] int addAtLikelyDepth(const NewFeature& feature, const Eigen::Vector2d& pixel,
                                     int anchor, int first);
  [[nodiscard]] const StateFeature& stateOf(int feature) const {
    return filter_.state().features()[static_cast<std::size_t>(feature)];
  }
  [[nodiscard]] bool isWellKnown(int feature) const;

  VisualFilterOptions options_;
  FeatureFilter filter_;
  bool running_ = false;
  bool assumes_scale_ = false;
  std::vector<Feature> features_;  // by their place in the state
  PointMemory memory_;
  int told_views_ = 0;  // that were recalled since the pose was last known as well as all of them
  std::array<ImageReducer, 2> reducers_;
  ImageLevels levels_;  // of the image at hand
  CornerFinder corners_;
  double marker_depth_m_ = 0.0;  // of the last markers; 0 without any
  int next_surface_ = 0;
  int frames_since_lot_ = 0;
  double frame_s_ = 0.0;  // since the last frame
  double readout_s_ = 0.0;
  double wary_s_ = 0.0;     // still to come
  double running_s_ = 0.0;  // since the start
  bool was_blind_ = false;  // the last frame with an image

  // Of the frame at hand.
  std::vector<Candidate> candidates_;
  std::vector<FeatureMatch> matches_;
  std::vector<int> candidate_of_match_;
  std::vector<int> ages_;
  std::vector<char> accepted_;
  std::vector<FoundCorner> found_corners_;
  std::vector<SurfacePoint> neighbours_;
  std::vector<char> occupied_;
  std::vector<Shown> shown_;
};

}  // namespace waymark::slam
