// The pieces of the map. Usually there is one. Where the camera is lost among markers that none of
// them knows, another one is begun, and poses go on in its world; pieces that frames with markers
// of both connect are joined. A marker has its place in one of them only; the views that others
// have of it are what connects them.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "slam/camera/lens_knowledge.h"
#include "slam/counters.h"
#include "slam/frame.h"
#include "slam/map/map.h"
#include "slam/mapping/recorded_frames.h"
#include "slam/options.h"
#include "slam/piece.h"
#include "slam/pose_estimate.h"
#include "slam/stages.h"

namespace waymark::slam {

class PieceSet {
 public:
  // All that is given by reference must outlive it.
  PieceSet(const Options& options, std::string dictionary, CameraModel* camera, LensKnowledge* lens,
           Counters* counters, Map map, std::vector<Map> others);

  // The one that the camera is in, or was in last.
  [[nodiscard]] const Piece& active() const { return *pieces_.at(active_); }
  // Null when there is none, or not any more.
  [[nodiscard]] const Piece* find(int piece) const;
  [[nodiscard]] std::vector<const Map*> maps() const;

  // All that becomes of a frame's detections: in the active piece, or else in another one.
  [[nodiscard]] FrameResult process(const FrameInput& frame,
                                    std::span<const MarkerDetection> detections,
                                    StageObserver* observer);
  // See Slam.
  [[nodiscard]] PoseEstimate asOfNow(PoseEstimate pose) const;

  // For the time when no frame waits.
  void densify(std::span<const RecordedFrame> frames);
  bool joinAll();
  void optimizeWithIntrinsics();
  // The lens, from all of the piece with the most to say of it.
  void estimateLens();
  template <typename Do>
  void forEach(const Do& action) {
    for (auto& [id, piece] : pieces_) action(*piece);
  }

 private:
  // What became of a piece that was joined.
  struct Joined {
    int into = 0;
    Transform T_into_piece;
  };

  [[nodiscard]] Piece& active() { return *pieces_.at(active_); }
  [[nodiscard]] std::unique_ptr<Piece> makePiece(Map map) const;
  [[nodiscard]] bool hasSeveral() const { return pieces_.size() > 1; }
  void goElsewhere(const FrameInput& frame, std::span<const MarkerDetection> detections,
                   StageObserver* observer, FrameResult* result);
  [[nodiscard]] std::vector<int> piecesInView(std::span<const MarkerDetection> detections) const;
  void begin(const FrameInput& frame, std::span<const MarkerDetection> detections,
             StageObserver* observer, FrameResult* result);
  [[nodiscard]] bool isPlaced(int marker_id) const;
  [[nodiscard]] bool isNobodys(const MarkerDetection& detection) const;
  void tellWhatOthersHave(int id, std::span<const MarkerDetection> detections);
  [[nodiscard]] std::vector<int> claim(int piece);
  void connect(const FrameInput& frame, std::span<const MarkerDetection> detections,
               FrameResult* result);
  // What a piece has learned of the lens is true of all.
  void spreadLens(int from);
  [[nodiscard]] Piece& largest();
  // Of two pieces the one that is left; -1: they are two still.
  int tryToJoin(int a, int b);
  [[nodiscard]] bool givesWay(int piece, int to) const;

  const Options& options_;
  CameraModel* camera_;
  LensKnowledge* lens_;
  Counters* counters_;
  std::string dictionary_;
  std::map<int, std::unique_ptr<Piece>> pieces_;  // by id
  int active_ = 0;
  int next_id_ = 1;
  std::unique_ptr<Piece> next_;  // not begun yet; null as long as it was not needed
  std::map<int, int> owner_;     // the piece that a marker has its place in; empty with one piece
  std::map<int, Joined> joined_;
};

}  // namespace waymark::slam
