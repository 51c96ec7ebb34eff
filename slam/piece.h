// One piece of the map, with a world of its own, and all that follows the camera in it: the stages
// of seed 1, Fig. 4, behind the detection. While the camera is elsewhere it rests.
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "slam/camera/lens_knowledge.h"
#include "slam/camera/readout_estimate.h"
#include "slam/counters.h"
#include "slam/frame.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/options.h"
#include "slam/pieces/joined_map.h"
#include "slam/pieces/piece_joint.h"
#include "slam/pose_estimate.h"
#include "slam/stages.h"
#include "slam/tracking/local_markers.h"
#include "slam/tracking/prediction.h"

namespace waymark::slam {

class BatchMapper;

// What all pieces share; it must outlive them.
struct PieceParts {
  const Options& options;
  CameraModel* camera;
  LensKnowledge* lens;
  Counters* counters;
  ReadoutEstimate readout;  // as learned so far
};

// Whose turn a frame is.
enum class Turn {
  kOwn,     // of the piece that the camera was in last
  kOthers,  // it was lost there: other pieces are tried; what the frame is like was counted before
};

class Piece {
 public:
  // Goes on with `map` where it is not empty.
  Piece(const PieceParts& parts, Map map);
  ~Piece();
  Piece(const Piece&) = delete;
  Piece& operator=(const Piece&) = delete;

  [[nodiscard]] const Map& map() const;
  [[nodiscard]] const LocalMarkers& local() const;
  [[nodiscard]] std::optional<Prediction> predict(std::int64_t time_ns) const;
  [[nodiscard]] ReadoutEstimate readout() const;

  // All that becomes of a frame's detections. The result's pose says the piece. `work` is what may
  // be spent on optimizations, as of Options::work_per_frame.
  [[nodiscard]] FrameResult process(const FrameInput& frame,
                                    std::span<const MarkerDetection> detections, Turn turn,
                                    double work, StageObserver* observer);

  // The marker has its place in another piece (false: not any more); nothing happens where it has
  // one here, too, or is banned.
  void setElsewhere(int marker_id, bool elsewhere);
  // The id hangs twice; nothing happens where it is not known.
  void ban(int marker_id);
  // What connects it with another piece: see slam/pieces/piece_joint.h.
  [[nodiscard]] JointParts jointParts() const;
  // While it is joined with another piece, which takes some frames, the map does not grow, and what
  // is under way waits. Poses go on.
  void hold(bool held);
  // It has taken in another piece: that is its map from now on; optimizations follow, in slices.
  // The map as it was.
  [[nodiscard]] Map adopt(JoinedMap joined);
  // Another piece has taken it in: its map, which it is without from now on.
  [[nodiscard]] Map takeMap();
  // Of one that nobody needs any more, as letting go of a large one takes milliseconds: so much of
  // it goes. True when little is left.
  bool letGo(int count);
  // The camera is here, though another piece has told so.
  void comeIn(const PoseEstimate& pose, std::int64_t time_ns);

  // The camera's lens is another one, as another piece has learned.
  void undistortAgain();
  // What is under way is done, and the lens estimated from all there is. Whether it is another one.
  bool estimateLens();

  // For the time when no frame waits; what is under way is done first.
  [[nodiscard]] BatchMapper& batch();
  [[nodiscard]] const BatchMapper& batch() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace waymark::slam
