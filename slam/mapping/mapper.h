// The map's growth, frame by frame (seed 1, sections 4.4 to 4.7): keyframes, new markers, ambiguous
// markers, local optimization, culling; and what fixes the world.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <utility>

#include "base/task.h"
#include "slam/counters.h"
#include "slam/initialization/initializer.h"
#include "slam/keyframes/keyframe_culler.h"
#include "slam/keyframes/keyframe_policy.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/mapping/gap_mapper.h"
#include "slam/mapping/picture_mapper.h"
#include "slam/marker_pose/marker_resolver.h"
#include "slam/optimization/map_optimizer.h"

namespace waymark::slam {

struct MapperOptions {
  KeyframeOptions keyframes;
  MarkerResolverOptions marker_pose;
  GapMapperOptions gaps;
  PictureMapperOptions pictures;
  LocalMapOptions local_map;
  // After each keyframe. Few iterations do: the next keyframe's goes on from there.
  BundleOptions local_optimization{.max_iterations = 5, .min_relative_decrease = 1e-3};
  // The share of a frame's work (Options::work_per_frame) that local optimization may take while a
  // loop closure or the readout time wants to go on, too; what it leaves is theirs. Larger keeps
  // the neighbourhood better, smaller closes loops sooner.
  double work_share = 0.5;
  // Keyframes that must have seen a marker before it is decided anew between its pose and the other
  // one; marker_pose.min_views is for markers without a pose. Larger lives longer with a pose that
  // one view has chosen, smaller than two cannot tell the two apart.
  int second_look_views = 2;
  // From at most so many of its views a marker is decided between its poses, spread evenly over
  // all. Each is compared with each: more decides no better and makes the frame long.
  int most_views = 12;
  // With each of its first so many views a marker's pose is optimized by itself, the keyframes
  // held. More costs time with every keyframe, fewer leaves it where its first view has put it
  // until an optimization comes to it, and the next views do not fit.
  int young_views = 8;
  // What deciding and refining the markers of a new keyframe may take of its frame, in the units of
  // Options::work_per_frame; the frames after it go on. More only matters where a frame sees very
  // many undecided markers, and makes that frame long.
  double marker_cost = 800.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

class Mapper {
 public:
  Mapper(const MarkerOptions& markers, double focal_px, const MapperOptions& options)
      : markers_(markers), focal_px_(focal_px), options_(options), culler_(options.keyframes) {}

  // The first keyframes and markers of an empty map. Returns where the last of them is.
  Transform begin(const Start& start, Map* map, Counters* counters);

  // Whether the rules of section 4.4 want a frame as a keyframe. detections: those that fit its
  // pose, and those the map does not know.
  [[nodiscard]] bool wants(std::span<const MarkerDetection> detections, const Transform& T_w_c,
                           const Map& map) const;
  // Makes the frame a keyframe. A local optimization around it is wanted then: work() does it.
  void insert(const Keyframe& frame, Map* map, Counters* counters);
  // The same with what was carried through a gap: its marker hangs where the joint says.
  void insert(const GapJoint& joint, Map* map, Counters* counters);
  // Markers of keyframes that were inserted before, for which those frames had no time any more;
  // a frame that inserts one has none for it, either. True when there were some: the map may have
  // changed.
  bool catchUp(Map* map, Counters* counters);
  // A local optimization around this keyframe is wanted.
  void want(KeyframeId keyframe) { wanted_ = keyframe; }
  // What a picture changes. Precondition: it is among the map's markers.
  void insert(const PictureJoint& joint, Map* map, Counters* counters);
  // Section 4.5 for all markers without a pose, as sure as the whole map is of itself: what could
  // not be decided as the frames came may be with more views and better cameras.
  void resolveAll(Map* map);
  // A slice of the local optimization, and the next one when one is done. The units left.
  double work(double cost, const Map& map);
  // Puts a local optimization that is done into the map. What that did to the keyframe it was for:
  // T_new_old; empty when none is done.
  std::optional<Transform> collect(Map* map, Counters* counters);
  [[nodiscard]] bool isDone() const { return local_ && local_->done(); }
  // What was to fix the world has a place since, and all coordinates are others: T_new_old. Once.
  [[nodiscard]] std::optional<Transform> takeWorldMotion() {
    return std::exchange(world_moved_, std::nullopt);
  }
  [[nodiscard]] bool worldMoved() const { return world_moved_.has_value(); }
  // Nothing is wanted, and nothing waits to be collected.
  [[nodiscard]] bool idle() const { return !local_ && !wanted_; }

  // Standard deviation of the map's whitened residuals as of late, at least 1.
  [[nodiscard]] double residualSigma() const { return residual_sigma_; }

 private:
  [[nodiscard]] std::vector<InitialMarker> unambiguousNewMarkers(
      std::span<const MarkerDetection> detections, const Transform& T_w_c, const Map& map) const;
  void pose(int marker_id, const Transform& T_w_m, const std::optional<Transform>& other,
            Map* map) const;
  void seeToMarkers(Map* map, Counters* counters);
  double resolve(int marker_id, Map* map, Counters* counters) const;
  double refineYoung(int marker_id, Map* map) const;
  // As seen from these keyframes.
  [[nodiscard]] MarkerResolution resolution(int marker_id, std::span<const KeyframeId> seen_from,
                                            int min_views, const Map& map) const;
  void fixWorld(Map* map);

  MarkerOptions markers_;
  double focal_px_;
  MapperOptions options_;
  KeyframeCuller culler_;
  std::vector<int> to_resolve_;  // markers of new keyframes, the next one first
  std::vector<int> to_refine_;   // likewise, once those are done
  double residual_sigma_ = 1.0;
  // The local optimization under way, and the keyframe it is for; and the one that wants the next.
  std::optional<SlicedTask<MapCorrection>> local_;
  KeyframeId local_keyframe_ = -1;
  std::optional<KeyframeId> wanted_;
  bool world_fixed_ = false;              // by an origin marker or an anchor
  std::optional<Transform> world_moved_;  // T_new_old, that nobody was told of yet
};

}  // namespace waymark::slam
