#include "slam/final_map.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <utility>

#include "base/elapsed.h"
#include "slam/camera/undistort_map.h"
#include "slam/slam.h"

namespace waymark::slam {
namespace {

void undistortAgain(const Slam& slam, std::span<LiveFrame> frames) {
  for (LiveFrame& frame : frames) {
    undistortAgain(slam.lens().at(frame.monotonic_ns, slam.camera()), &frame.detections);
  }
}

void optimize(std::span<LiveFrame> frames, bool refine_intrinsics, Slam* slam) {
  const LensKnowledge& lens = slam->lens();
  const bool lens_learned = lens.state != LensState::kGiven && !lens.changedUnderWay();
  if (refine_intrinsics || lens_learned) {
    slam->optimizeGloballyWithIntrinsics();
    undistortAgain(*slam, frames);
  } else {
    slam->optimizeGlobally();
  }
}

// Sets `wanted` of the flags at the places `from`, evenly spread; all of them where there are
// fewer.
void chooseEvenly(const std::vector<std::size_t>& from, std::size_t wanted,
                  std::vector<bool>* chosen) {
  const std::size_t count = std::min(wanted, from.size());
  for (std::size_t k = 0; k < count; ++k) (*chosen)[from[k * from.size() / count]] = true;
}

// Whether each frame is one of spreadFrames().
std::vector<bool> chosenFrames(std::span<const LiveFrame> frames, const FinalMapOptions& options) {
  std::vector<bool> chosen(frames.size(), false);
  std::vector<std::size_t> all(frames.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  chooseEvenly(all, options.frames, &chosen);
  std::map<int, std::vector<std::size_t>> seen_in;  // frames by marker
  for (const std::size_t i : all) {
    for (const MarkerDetection& detection : frames[i].detections) {
      seen_in[detection.id].push_back(i);
    }
  }
  for (const auto& [id, views] : seen_in) {
    const auto chosen_views = static_cast<std::size_t>(
        std::count_if(views.begin(), views.end(), [&](std::size_t i) { return chosen[i]; }));
    if (chosen_views < options.views_per_marker) {
      chooseEvenly(views, options.views_per_marker, &chosen);
    }
  }
  return chosen;
}

}  // namespace

void makeFinalMap(std::span<LiveFrame> frames, const FinalMapOptions& options, Slam* slam) {
  if (options.unordered_images) tryAgain(frames, slam);
  slam->finish();
  if (!options.optimize) return;
  if (slam->lens().changes > 0) undistortAgain(*slam, frames);
  if (frames.empty()) {
    optimize(frames, options.refine_intrinsics, slam);
    return;
  }
  for (int round = 0; round < options.rounds; ++round) {
    slam->densify(spreadFrames(frames, options));
    (void)slam->joinPieces();
    const int lens_changes = slam->lens().changes;
    slam->estimateLens();
    if (slam->lens().changes != lens_changes) undistortAgain(*slam, frames);
    optimize(frames, options.refine_intrinsics, slam);
  }
  // What a frame shows may be known by now, and connect others.
  while (slam->joinPieces()) {
    slam->densify(spreadFrames(frames, options));
    optimize(frames, options.refine_intrinsics, slam);
  }
}

void tryAgain(std::span<const LiveFrame> frames, Slam* slam) {
  std::vector<std::size_t> left;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (!frames[i].pose) left.push_back(i);
  }
  std::size_t before = 0;
  do {
    before = left.size();
    std::erase_if(left, [&](std::size_t i) {
      const LiveFrame& frame = frames[i];
      return slam
          ->process({.time = {i, frame.monotonic_ns},
                     .detections = frame.detections,
                     .found = frame.found})
          .pose.has_value();
    });
  } while (left.size() < before && !left.empty());
}

Twist motionOf(std::span<const LiveFrame> frames, std::size_t i) {
  const auto& pose = frames[i].pose;
  if (!pose) return Twist::Zero();
  if (i + 1 == frames.size()) return pose->twist;
  const LiveFrame& next = frames[i + 1];
  const double after_s = secondsBetween(frames[i].monotonic_ns, next.monotonic_ns);
  if (!next.pose || next.pose->piece != pose->piece) return pose->twist;
  return twistBetween(pose->twist, next.pose->twist, after_s);
}

std::vector<RecordedFrame> spreadFrames(std::span<const LiveFrame> frames,
                                        const FinalMapOptions& options) {
  std::vector<RecordedFrame> spread;
  const auto first =
      std::ranges::find_if(frames, [](const LiveFrame& f) { return f.pose.has_value(); });
  if (first == frames.end()) return spread;
  const PoseEstimate* near = &*first->pose;
  const std::vector<bool> chosen = chosenFrames(frames, options);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const LiveFrame& frame = frames[i];
    if (frame.pose) near = &*frame.pose;
    if (!chosen[i]) continue;
    spread.push_back(
        {i, frame.monotonic_ns, frame.detections, near->T_w_c, motionOf(frames, i), near->piece});
  }
  return spread;
}

std::vector<Map> piecesThroughOneLens(const Slam& slam) {
  std::vector<Map> pieces;
  for (const Map* const piece : slam.pieces()) {
    pieces.push_back(*piece);
    if (slam.lens().changedUnderWay()) seeThroughOne(slam.camera(), slam.lens(), &pieces.back());
  }
  return pieces;
}

}  // namespace waymark::slam
