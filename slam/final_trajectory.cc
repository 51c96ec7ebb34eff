#include "slam/final_trajectory.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "base/elapsed.h"
#include "slam/covariance/excess_covariance.h"
#include "slam/final_smoother.h"
#include "slam/slam.h"
#include "slam/tracking/single_marker_view.h"

namespace waymark::slam {
namespace {

// How the camera moved in each frame.
using Motions = std::vector<Twist>;

Motions motionsLive(std::span<const LiveFrame> frames) {
  Motions motions(frames.size());
  for (std::size_t i = 0; i < frames.size(); ++i) motions[i] = motionOf(frames, i);
  return motions;
}

// From the frame before to the one after, where both have a pose; else as it was.
void moveAlong(std::span<const LiveFrame> frames,
               std::span<const std::optional<PoseEstimate>> poses, Motions* motions) {
  constexpr double kLonger_s = 0.4;  // says nothing of a moment
  for (std::size_t i = 1; i + 1 < frames.size(); ++i) {
    if (!poses[i - 1] || !poses[i] || !poses[i + 1]) continue;
    const double dt_s = secondsBetween(frames[i - 1].monotonic_ns, frames[i + 1].monotonic_ns);
    if (!(dt_s > 0.0) || dt_s > kLonger_s) continue;
    const Transform& before = poses[i - 1]->T_w_c;
    const Transform& after = poses[i + 1]->T_w_c;
    (*motions)[i] << poses[i]->T_w_c.R.transpose() * (after.p - before.p) / dt_s,
        logSo3(before.R.transpose() * after.R) / dt_s;
  }
}

RecordedFrame recorded(std::span<const LiveFrame> frames, std::size_t i, const Transform& guess,
                       const Twist& motion, int piece) {
  const LiveFrame& frame = frames[i];
  return {i, frame.monotonic_ns, frame.detections, guess, motion, piece, frame.found};
}

// Each frame for itself, near where it was live. One that was lost starts from its neighbour: first
// the one before, then, for the frames in front of the first pose, the one after.
std::vector<std::optional<PoseEstimate>> localizeEach(std::span<const LiveFrame> frames,
                                                      const Motions& motions, int piece,
                                                      const Slam& slam) {
  std::vector<std::optional<PoseEstimate>> poses(frames.size());
  std::optional<Transform> neighbour;
  const auto localize = [&](std::size_t i) {
    if (!poses[i]) {
      const auto& live = frames[i].pose;
      const std::optional<Transform> guess = live ? live->T_w_c : neighbour;
      if (!guess) return;
      poses[i] = slam.localize(recorded(frames, i, *guess, motions[i], piece));
    }
    if (poses[i]) neighbour = poses[i]->T_w_c;
  };
  for (std::size_t i = 0; i < frames.size(); ++i) localize(i);
  neighbour.reset();
  for (std::size_t i = frames.size(); i-- > 0;) localize(i);
  return poses;
}

NoPoseReason reasonFor(const LiveFrame& frame, std::span<const Map* const> pieces) {
  if (frame.detections.empty()) return NoPoseReason::kNoMarker;
  const auto known = std::ranges::count_if(frame.detections, [&](const MarkerDetection& seen) {
    return std::ranges::any_of(pieces,
                               [&](const Map* map) { return map->findPosed(seen.id) != nullptr; });
  });
  if (known == 0) return NoPoseReason::kNoKnownMarker;
  return known == 1 ? NoPoseReason::kAmbiguousMarker : NoPoseReason::kMarkersDoNotFit;
}

// What each frame says to the sequence, and the two poses of those with a single marker.
struct Sequence {
  std::vector<SequenceFrame> frames;
  std::vector<std::optional<PosesOfOneMarker>> of_one;
};

Sequence sequenceOf(std::span<const LiveFrame> frames,
                    std::span<const std::optional<PoseEstimate>> poses, const Motions& motions,
                    int piece, const Slam& slam) {
  Sequence sequence{std::vector<SequenceFrame>(frames.size()),
                    std::vector<std::optional<PosesOfOneMarker>>(frames.size())};
  for (std::size_t i = 0; i < frames.size(); ++i) {
    SequenceFrame& out = sequence.frames[i];
    out.time_ns = frames[i].monotonic_ns;
    // Where nothing was near, a single marker says no more than where it is.
    const auto& near = frames[i].pose ? frames[i].pose : poses[i];
    const Transform guess = near ? near->T_w_c : Transform{};
    sequence.of_one[i] = slam.localizeByOneMarker(recorded(frames, i, guess, motions[i], piece));
    if (const auto& both = sequence.of_one[i]) {
      out.poses = 2;
      out.marker = both->marker;
      for (std::size_t k = 0; k < 2; ++k) {
        out.T_w_c[k] = both->poses[k].T_w_c;
        out.covariance[k] = both->poses[k].view_covariance;
      }
      out.log_odds = both->log_odds;
      out.barrier = both->barrier;
    } else if (poses[i] && poses[i]->markers_used > 1) {
      out.poses = 1;
      out.T_w_c[0] = poses[i]->T_w_c;
      out.covariance[0] = poses[i]->view_covariance;
    }
  }
  return sequence;
}

// near: what the frame for itself would have, where there is such a pose.
std::optional<PoseEstimate> poseOfOneMarker(const PosesOfOneMarker& both,
                                            const Eigen::Vector3d& marker_w,
                                            double log_odds_of_first,
                                            const std::optional<PoseEstimate>& near,
                                            const SingleMarkerSequenceOptions& options) {
  const bool two = both.barrier >= options.judge.min_barrier;
  const double log_odds = std::abs(log_odds_of_first);
  if (two && log_odds < options.min_pose_log_odds) return std::nullopt;
  if (!two && !near) return std::nullopt;
  const std::size_t better = log_odds_of_first >= 0.0 ? 0 : 1;
  PoseEstimate pose = two ? both.poses[better] : *near;
  const PoseOfTwo of_two = PoseOfTwo{both.poses[better].T_w_c,
                                     both.poses[1 - better].T_w_c,
                                     marker_w,
                                     log_odds,
                                     both.barrier,
                                     two && log_odds >= options.judge.min_log_odds}
                               .at(pose.T_w_c);
  const Matrix6d cover = coverOfOtherPose(of_two, pose.view_covariance);
  pose.covariance += cover;
  pose.view_covariance += cover;
  pose.ambiguity_ratio =
      ambiguityOf(of_two, pose.ambiguity_ratio, options.decided_ratio, options.judge.min_log_odds);
  return pose;
}

bool wasCarried(const LiveFrame& frame, const std::optional<PoseEstimate>& placed) {
  if (placed || !frame.pose) return false;
  return frame.pose->source != PoseSource::kMarkers || frame.pose->features_used > 0;
}

double positionVariance(const Matrix6d& covariance) {
  return covariance.topLeftCorner<3, 3>().trace();
}

// What two markers or more say is not given up for features that contradict it: these were followed
// through the lens of their time. A single marker may be taken for its mirror image.
bool contradicts(const SmoothedPose& smoothed, const PoseEstimate& of_markers) {
  constexpr double kSurely = 16.3;  // the 99.9 % quantile of a position's chi-square
  constexpr double kWellTurned_rad =
      0.05;  // beyond it a covariance says too little of the other pose
  const double turned = of_markers.view_covariance.bottomRightCorner<3, 3>().trace();
  if (of_markers.markers_used < 2 || turned > kWellTurned_rad * kWellTurned_rad) return false;
  const Eigen::Vector3d apart = smoothed.T_w_c.p - of_markers.T_w_c.p;
  const Eigen::Matrix3d covariance =
      (smoothed.covariance + of_markers.view_covariance).topLeftCorner<3, 3>();
  return apart.dot(covariance.ldlt().solve(apart)) > kSurely;
}

// Frames between markers, whose poses were carried live by natural features, and those whose
// markers (a single one, far away) say less than that, the frames around and the features do.
void fillGaps(std::span<const LiveFrame> frames, std::vector<std::optional<PoseEstimate>>* poses) {
  const auto used_features = [](const LiveFrame& frame) {
    return frame.pose && frame.pose->features_used > 0;
  };
  const auto smoothed = smoothTrajectory(frames, *poses);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    std::optional<PoseEstimate>& pose = (*poses)[i];
    if (!smoothed[i]) continue;
    const Matrix6d& covariance = smoothed[i]->covariance;
    const bool says_less = pose && used_features(frames[i]) &&
                           positionVariance(pose->view_covariance) > positionVariance(covariance) &&
                           !contradicts(*smoothed[i], *pose);
    if (!says_less && !wasCarried(frames[i], pose)) continue;
    // What the map does not know of its markers stays.
    const PoseEstimate& of_world = pose ? *pose : *frames[i].pose;
    const Matrix6d in_world = excessOf(of_world.covariance, of_world.view_covariance);
    pose = frames[i].pose;
    pose->T_w_c = smoothed[i]->T_w_c;
    pose->view_covariance = covariance;
    pose->covariance = covariance + in_world;
  }
}

// Photographs that were placed by a picture, and are not by the map as it is.
void keepCarried(std::span<const LiveFrame> frames,
                 std::vector<std::optional<PoseEstimate>>* poses) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (wasCarried(frames[i], (*poses)[i])) (*poses)[i] = frames[i].pose;
  }
}

// Where no pose is from markers, live or now (pictures alone), nothing is known better than live.
void keepLive(std::span<const LiveFrame> frames, std::vector<std::optional<PoseEstimate>>* poses) {
  const auto of_markers = [](const LiveFrame& frame) {
    return frame.pose && frame.pose->source == PoseSource::kMarkers;
  };
  if (std::ranges::none_of(frames, of_markers)) keepCarried(frames, poses);
}

// The live frames as one piece of the map knows them: poses of others are none to it.
std::vector<LiveFrame> framesOf(std::span<const LiveFrame> frames, int piece, const Slam& slam) {
  std::vector<LiveFrame> theirs(frames.begin(), frames.end());
  for (LiveFrame& frame : theirs) {
    if (!frame.pose) continue;
    frame.pose = slam.asOfNow(*frame.pose);
    if (frame.pose->piece != piece) frame.pose.reset();
  }
  return theirs;
}

// In one piece.
std::vector<std::optional<PoseEstimate>> localizeIn(const Map& map,
                                                    std::span<const LiveFrame> frames,
                                                    const FinalTrajectoryOptions& options,
                                                    const Slam& slam) {
  // Live motions are of live poses: through a lens, or in a map, that was not known yet, they move
  // a rolling shutter's corners by pixels. Each time a tenth is left of that.
  constexpr int kTimes = 2;
  Motions motions = motionsLive(frames);
  auto poses = localizeEach(frames, motions, map.piece, slam);
  const bool rolls = slam.readout_s() != 0.0 && !options.unordered_images;
  for (int i = 0; rolls && i < kTimes; ++i) {
    moveAlong(frames, poses, &motions);
    poses = localizeEach(frames, motions, map.piece, slam);
  }
  // Without any there is no map of markers, or the frames are not of it.
  const bool any = std::ranges::any_of(poses, [](const auto& pose) { return pose.has_value(); });
  if (any && !options.unordered_images) {
    const Sequence sequence = sequenceOf(frames, poses, motions, map.piece, slam);
    const auto log_odds = logOddsOfFirst(sequence.frames, options.single_marker);
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const auto& both = sequence.of_one[i];
      if (!both) continue;
      poses[i] = poseOfOneMarker(*both, map.findPosed(both->marker)->T_w_m->p, log_odds[i],
                                 poses[i], options.single_marker);
    }
  }
  if (options.unordered_images) {
    keepCarried(frames, &poses);
  } else if (any) {
    fillGaps(frames, &poses);
  } else {
    keepLive(frames, &poses);
  }
  return poses;
}

}  // namespace

std::vector<FinalPose> localizeAll(std::span<const LiveFrame> frames,
                                   const FinalTrajectoryOptions& options, const Slam& slam) {
  std::vector<FinalPose> all(frames.size());
  const std::vector<const Map*> pieces = slam.pieces();
  for (const Map* const map : pieces) {
    const bool all_here = std::ranges::all_of(frames, [&](const LiveFrame& frame) {
      return !frame.pose || frame.pose->piece == map->piece;
    });
    auto poses = all_here ? localizeIn(*map, frames, options, slam)
                          : localizeIn(*map, framesOf(frames, map->piece, slam), options, slam);
    for (std::size_t i = 0; i < frames.size(); ++i) {
      if (!poses[i]) continue;
      poses[i]->piece = map->piece;
      // Of several the one from most markers, and of these the oldest.
      auto& best = all[i].pose;
      if (!best || poses[i]->markers_used > best->markers_used) best = std::move(poses[i]);
    }
  }
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (!all[i].pose) all[i].reason = reasonFor(frames[i], pieces);
  }
  return all;
}

}  // namespace waymark::slam
