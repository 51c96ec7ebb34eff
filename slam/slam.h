// The SLAM system: frames in, camera poses and a marker map out. Single-threaded and deterministic:
// no clocks, no files; time comes in with the frame.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "slam/camera/lens_knowledge.h"
#include "slam/counters.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/frame.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/mapping/recorded_frames.h"
#include "slam/options.h"
#include "slam/pose_estimate.h"
#include "slam/stages.h"

namespace waymark::slam {

class Slam {
 public:
  // Goes on with `map` (of the same dictionary) where one is given; it then starts by relocalizing.
  // Precondition: options.invalidReason() is empty.
  // other_pieces: of a map in pieces, those after the first.
  Slam(const CameraModel& camera, Dictionary dictionary, const Options& options, Map map = {},
       std::vector<Map> other_pieces = {});
  ~Slam();
  Slam(const Slam&) = delete;
  Slam& operator=(const Slam&) = delete;

  // The next frame. Precondition: an image has the camera's size. `observer` may be null.
  FrameResult process(const FrameInput& frame, StageObserver* observer = nullptr);

  // The piece of the map that the camera is in, or was in last.
  [[nodiscard]] const Map& map() const;
  // All of them, each with its own world, in the order of their ids (Map::piece). Usually one.
  // Valid until the next frame.
  [[nodiscard]] std::vector<const Map*> pieces() const;
  // A pose that was told of a piece which is part of another one by now: in the world of that.
  [[nodiscard]] PoseEstimate asOfNow(PoseEstimate pose) const;
  [[nodiscard]] const Counters& counters() const;
  // The lens in use: as given, or as learned.
  [[nodiscard]] const CameraModel& camera() const;
  [[nodiscard]] const LensKnowledge& lens() const;

  // The map is forgotten, and begun with the next frame; what is known of the lens stays.
  // Precondition: it was not given.
  void beginAnew();
  // What is under way (Options::work_per_frame) is done to its end, and in the map.
  void finish();
  // Makes keyframes of frames that were none while they came, and gives those that were the markers
  // that fit by now: the optimization at the end of a recording need not be fast, and more views
  // make a better map than section 4.10's keyframes alone. Each frame is located against the map as
  // it is now; those that do not fit are left out. Does nothing when mapping is off.
  void densify(std::span<const RecordedFrame> frames);
  // Joins the pieces that their keyframes connect, whatever it costs; for the end of a recording.
  // Whether there were any.
  bool joinPieces();
  // The lens from all of the map, whatever it costs, for the end of a recording: another one is in
  // use where the map contradicts it (Options::lens).
  void estimateLens();
  // Global optimization of the whole map (section 4.10), for the end of a recording or a map that
  // is to be saved; does nothing when mapping is off.
  void optimizeGlobally();
  // The same with the intrinsics among the unknowns (Eq. 41), expected where the camera given at
  // the start has them: camera() is then the better lens.
  void optimizeGloballyWithIntrinsics();

  // A frame's pose against the piece of its guess as it is now; for trajectory_final. Empty when
  // too few of its markers are in there.
  [[nodiscard]] std::optional<PoseEstimate> localize(const RecordedFrame& frame) const;
  // The same of a frame in which that piece knows one marker only: at both of its poses. Empty
  // where it knows none or several, or one of the two does not fit.
  [[nodiscard]] std::optional<PosesOfOneMarker> localizeByOneMarker(
      const RecordedFrame& frame) const;
  // First to last row, seconds, as given or learned; 0 for a global shutter.
  [[nodiscard]] double readout_s() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace waymark::slam
