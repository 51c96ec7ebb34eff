// The pieces of the map. Usually there is one. Where the camera is lost among markers that none of
// them knows, another one is begun, and poses go on in its world; pieces that frames with markers
// of both connect are joined. A marker has its place in one of them only; the views that others
// have of it are what connects them.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/task.h"
#include "slam/camera/lens_knowledge.h"
#include "slam/counters.h"
#include "slam/frame.h"
#include "slam/map/map.h"
#include "slam/mapping/recorded_frames.h"
#include "slam/options.h"
#include "slam/piece.h"
#include "slam/pieces/joined_map.h"
#include "slam/pieces/joint_search.h"
#include "slam/pieces/joint_trial.h"
#include "slam/pieces/piece_joint.h"
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
  // Pieces that are being joined are one.
  void finishJoint();
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

  // The one that stays, the other.
  using Pair = std::pair<int, int>;

  [[nodiscard]] Piece& active() { return *pieces_.at(active_); }
  [[nodiscard]] std::unique_ptr<Piece> makePiece(Map map) const;
  [[nodiscard]] bool hasSeveral() const { return pieces_.size() > 1; }
  [[nodiscard]] double allowance() const;
  void noteInterval(std::int64_t time_ns);
  std::span<const MarkerDetection> believed(const FrameInput& frame,
                                            std::span<const MarkerDetection> detections);
  [[nodiscard]] const MarkerDetection* otherPrint(
      int piece, std::span<const MarkerDetection> detections) const;
  bool hangsOnOne(std::span<const MarkerDetection> detections, std::int64_t time_ns);
  [[nodiscard]] bool mayBeElsewhere(std::int64_t time_ns) const;
  std::span<const MarkerDetection> knownTo(int piece, std::span<const MarkerDetection> detections);
  void noteOtherPrint(int marker_id, std::int64_t time_ns);
  void refuse(int marker_id);
  void goElsewhere(const FrameInput& frame, std::span<const MarkerDetection> detections,
                   StageObserver* observer, FrameResult* result);
  [[nodiscard]] std::vector<int> piecesInView(std::span<const MarkerDetection> detections) const;
  void begin(const FrameInput& frame, std::span<const MarkerDetection> detections,
             StageObserver* observer, FrameResult* result);
  [[nodiscard]] bool isPlaced(int marker_id) const;
  [[nodiscard]] bool isNobodys(const MarkerDetection& detection) const;
  void tellWhatOthersHave(int id, std::span<const MarkerDetection> detections);
  [[nodiscard]] std::vector<int> claim(int piece);
  // What a piece has learned of the lens is true of all.
  void spreadLens(int from);
  [[nodiscard]] Piece& largest();
  void noteConnected(std::span<const MarkerDetection> detections, const FrameResult& result);
  void want(int a, int b);
  void lookForJoint(const FrameInput& frame, FrameResult* result);
  [[nodiscard]] std::optional<PieceJoint> decide(int into, int from,
                                                 const std::vector<JointView>& views) const;
  void beginJoint(const Pair& pair, const PieceJoint& joint);
  bool goOnJoining(double cost);
  void joinInSlices(const FrameInput& frame, FrameResult* result);
  void abandonJoint();
  void join(int into, int from, const PieceJoint& joint, JoinedMap joined);
  [[nodiscard]] bool isAnchored(int piece) const;
  [[nodiscard]] bool inOneSurvey(int a, int b) const;
  [[nodiscard]] PieceJoint inSurvey(int a, int b) const;
  void putOnTrial(Map into, Map from, const PieceJoint& joint);
  void follow(int from, const FrameInput& frame, FrameResult* result);
  void watchTrials(const FrameInput& frame, std::span<const MarkerDetection> detections,
                   StageObserver* observer, FrameResult* result);
  void part(std::size_t trial);
  void replace(int id, Map map);
  void endTrial(std::size_t trial);
  void retire(std::unique_ptr<Piece> piece);
  void letGoOfSome();
  void findCamera(const FrameInput& frame, std::span<const MarkerDetection> detections,
                  StageObserver* observer, FrameResult* result);
  [[nodiscard]] bool givesWay(int piece, int to) const;

  struct Search {
    Pair pair;
    JointSearch frames;
  };
  // Two pieces that are becoming one.
  struct Joining {
    Joining(const Pair& which, const PieceJoint& how) : pair(which), joint(how) {}

    Pair pair;
    PieceJoint joint;
    std::uint64_t changes = 0;  // of both maps, when the task was begun
    int begun = 0;              // times
    std::optional<SlicedTask<JoinedMap>> task;
  };
  // Frames in which a print looked like another one than the map knows.
  struct Suspicion {
    int frames = 0;
    std::int64_t since_ns = 0;
  };

  const Options& options_;
  CameraModel* camera_;
  LensKnowledge* lens_;
  Counters* counters_;
  std::string dictionary_;
  std::map<int, std::unique_ptr<Piece>> pieces_;  // by id
  int active_ = 0;
  int next_id_ = 1;
  std::optional<std::int64_t> last_pose_ns_;  // in any of them
  std::optional<std::int64_t> last_frame_ns_;
  double work_ = 0.0;            // that the frame may spend, units of Options::work_per_frame
  bool hangs_on_one_ = false;    // marker, since it was lost
  std::unique_ptr<Piece> next_;  // not begun yet; null as long as it was not needed
  std::map<int, int> owner_;     // the piece that a marker has its place in; empty with one piece
  std::map<int, Joined> joined_;
  std::set<int> anchored_;                // those that were found to be, with several
  std::set<std::pair<int, int>> wanted_;  // pieces that may be connected by now
  std::optional<Search> search_;
  std::unique_ptr<Joining> joining_;
  std::vector<JointTrial> trials_;                   // in the order of the joints
  std::map<Pair, std::vector<JointView>> refuting_;  // of joints undone, what refuted them
  std::vector<Map> gone_maps_;                       // to let go of, in slices
  std::vector<std::unique_ptr<Piece>> gone_pieces_;  // likewise
  std::map<int, Suspicion> suspicions_;              // by marker
  std::vector<MarkerDetection> believed_;            // of the last frame
  std::vector<PieceEvent> events_;                   // likewise
};

}  // namespace waymark::slam
