// The map at its best, for the end of a recording or a map that is to be saved: the global
// optimization of seed 1, section 4.10, and beyond it what can be done once nothing is in a hurry
// any more and all frames are known.
//
//   1. Images in no order that had no pose are tried again: what they show may be known by now.
//   2. Frames spread over the whole recording, and more of those that show a marker few of them do,
//      become keyframes: more views make a better map than section 4.4's keyframes alone.
//   3. Pieces of the map that these frames connect are joined, and all keyframes and markers are
//      optimized, with the lens if wanted.
//   4. 2 and 3 again: what did not fit the map as it was live may fit the better one; and once more
//      as long as any pieces are joined.
//
// A daemon that keeps no frames has step 3 alone. Where every frame is in that map,
// slam/final_trajectory tells.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/transform.h"
#include "slam/geometry/twist.h"
#include "slam/late_result.h"
#include "slam/map/map.h"
#include "slam/mapping/recorded_frames.h"
#include "slam/pose_estimate.h"

namespace waymark::slam {

class Slam;

// A frame of a recording, and what was told of it live. Its number is its place among them.
struct LiveFrame {
  std::int64_t monotonic_ns = 0;  // mid-exposure
  std::optional<PoseEstimate> pose;
  std::vector<MarkerDetection> detections;
  std::vector<LateResult> found{};  // pictures in it, of a photograph
};

// How the camera moved in the i-th frame, as it is known once the next one is; zero where it is
// not.
[[nodiscard]] Twist motionOf(std::span<const LiveFrame> frames, std::size_t i);

struct FinalMapOptions {
  // The frames are in no order (Options::treatAsUnorderedImages): those without a pose are tried
  // again. In a sequence they would be of a time long past.
  bool unordered_images = false;
  // Off: the map is left as it was live, but for what step 1 does and what is under way.
  bool optimize = true;
  // The lens is among the unknowns.
  bool refine_intrinsics = false;

  // Frames evenly spread over the recording. More take longer and are hardly better: neighbouring
  // frames see the same.
  std::size_t frames = 240;
  // Views of each marker wanted among them, as far as there are any; 0: whatever these happen to
  // show. One that was seen for a moment only needs them all; for the others more are hardly
  // better.
  std::size_t views_per_marker = 20;
  // Rounds of steps 2 and 3, each a whole optimization: the second takes in what did not fit the
  // map as it was live.
  int rounds = 2;
};

// Steps 1 to 4, in slam->map(). Without frames 3 alone. When the lens changes (slam->camera()), the
// frames' corners follow; a marker it cannot have seen leaves its frame.
void makeFinalMap(std::span<LiveFrame> frames, const FinalMapOptions& options, Slam* slam);

// Step 1: gives the frames without a pose to the SLAM again, in their order and until none finds
// its place any more: each one that does may show what places others.
void tryAgain(std::span<const LiveFrame> frames, Slam* slam);

// The frames of step 2, in their order. One that had no pose live comes with that of the last one
// before it that had (or, in front of the first, of that) and stands still. They point into
// `frames`. Empty when no frame had a pose.
[[nodiscard]] std::vector<RecordedFrame> spreadFrames(std::span<const LiveFrame> frames,
                                                      const FinalMapOptions& options);

// Copies of all pieces, as the lens in use would have seen them: a file has one camera.
[[nodiscard]] std::vector<Map> piecesThroughOneLens(const Slam& slam);

}  // namespace waymark::slam
