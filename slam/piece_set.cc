#include "slam/piece_set.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "base/elapsed.h"
#include "slam/batch_mapper.h"
#include "slam/camera/undistort_map.h"
#include "slam/frame_work.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/pieces/other_print.h"

namespace waymark::slam {
namespace {

// In another world, of which T_v_w says where the old one is.
PoseEstimate moved(PoseEstimate pose, const Transform& T_v_w, int piece) {
  pose.T_w_c = T_v_w * pose.T_w_c;
  pose.covariance = turnedCovariance(T_v_w.R, pose.covariance);
  pose.view_covariance = turnedCovariance(T_v_w.R, pose.view_covariance);
  pose.piece = piece;
  return pose;
}

}  // namespace

PieceSet::PieceSet(const Options& options, std::string dictionary, CameraModel* camera,
                   LensKnowledge* lens, Counters* counters, Map map, std::vector<Map> others)
    : options_(options),
      camera_(camera),
      lens_(lens),
      counters_(counters),
      dictionary_(std::move(dictionary)),
      active_(map.piece) {
  pieces_.emplace(active_, makePiece(std::move(map)));
  for (Map& other : others) {
    const int id = other.piece;
    pieces_.emplace(id, makePiece(std::move(other)));
  }
  next_id_ = pieces_.rbegin()->first + 1;
  if (!hasSeveral()) return;
  for (const auto& [id, piece] : pieces_) (void)claim(id);
}

std::unique_ptr<Piece> PieceSet::makePiece(Map map) const {
  map.dictionary = dictionary_;
  const ReadoutEstimate at_start{options_.shutter.learned_s, options_.shutter.unknown_s};
  const ReadoutEstimate readout = pieces_.empty() ? at_start : active().readout();
  return std::make_unique<Piece>(PieceParts{options_, camera_, lens_, counters_, readout},
                                 std::move(map));
}

const Piece* PieceSet::find(int piece) const {
  const auto found = pieces_.find(piece);
  return found == pieces_.end() ? nullptr : found->second.get();
}

std::vector<const Map*> PieceSet::maps() const {
  std::vector<const Map*> maps;
  for (const auto& [id, piece] : pieces_) maps.push_back(&piece->map());
  return maps;
}

PoseEstimate PieceSet::asOfNow(PoseEstimate pose) const {
  for (auto found = joined_.find(pose.piece); found != joined_.end();
       found = joined_.find(pose.piece)) {
    pose = moved(pose, found->second.T_into_piece, found->second.into);
  }
  return pose;
}

FrameResult PieceSet::process(const FrameInput& frame, std::span<const MarkerDetection> detections,
                              StageObserver* observer) {
  events_.clear();
  noteInterval(frame.time.monotonic_ns);
  tellWhatOthersHave(active_, detections);
  FrameResult result;
  auto trusted = believed(frame, detections);
  if (hangsOnOne(trusted, frame.time.monotonic_ns)) {
    begin(frame, detections, observer, &result);
    trusted = knownTo(active_, trusted);
  }
  if (!result.pose) {
    const int lens_changes = lens_->changes;
    result = active().process(frame, trusted, Turn::kOwn, allowance(), observer);
    if (lens_->changes != lens_changes) spreadLens(active_);
  }
  result.detections = detections;
  if (trusted.size() < detections.size() && result.pose &&
      result.pose->source != PoseSource::kMarkers) {
    result.pose.reset();  // carried from where the camera only seemed to be
    result.state = TrackingState::kRelocalizing;
    result.reason = NoPoseReason::kMarkersDoNotFit;
  }
  if (!result.pose && !active().map().empty()) goElsewhere(frame, detections, observer, &result);
  if (options_.mapping && (hasSeveral() || !trials_.empty())) {
    if (result.map_changed || result.keyframe_added) noteConnected(detections, result);
    watchTrials(frame, detections, observer, &result);
    const StageScope scope(observer, Stage::kMap);
    lookForJoint(frame, &result);
  }
  letGoOfSome();
  if (result.pose) last_pose_ns_ = frame.time.monotonic_ns;
  result.piece_events = events_;
  return result;
}

// What the piece that the camera is in may spend; the rest is for the search.
double PieceSet::allowance() const {
  constexpr double kShareOfSearch = 0.5;
  const bool searching = search_ || joining_ || !wanted_.empty();
  return (searching ? 1.0 - kShareOfSearch : 1.0) * work_;
}

void PieceSet::noteInterval(std::int64_t time_ns) {
  work_ = frameWork(options_, last_frame_ns_ ? secondsBetween(*last_frame_ns_, time_ns) : 0.0);
  last_frame_ns_ = time_ns;
}

// Without a marker that is another print than the one that the active piece knows.
std::span<const MarkerDetection> PieceSet::believed(const FrameInput& frame,
                                                    std::span<const MarkerDetection> detections) {
  if (!options_.mapping || !options_.pieces.begin || detections.size() < 2) return detections;
  const MarkerDetection* const other = otherPrint(active_, detections);
  std::optional<int> left_out;
  if (other != nullptr) left_out = other->id;
  if (hasSeveral()) {
    for (const int id : piecesInView(detections)) {
      if (id == active_) continue;
      if (const MarkerDetection* const theirs = otherPrint(id, detections)) {
        noteOtherPrint(theirs->id, frame.time.monotonic_ns);
      }
    }
  }
  if (!left_out) return detections;
  noteOtherPrint(*left_out, frame.time.monotonic_ns);
  believed_.assign(detections.begin(), detections.end());
  std::erase_if(believed_, [&](const MarkerDetection& d) { return d.id == *left_out; });
  return believed_;
}

// Found again by one marker, among others that nobody knows: if that id hangs twice, the camera may
// be anywhere, and what it sees must not grow into the piece. A new piece says so; what joins the
// two is tested. Until one has begun, or a second marker is known, the pose goes on by that one.
bool PieceSet::hangsOnOne(std::span<const MarkerDetection> detections, std::int64_t time_ns) {
  if (!options_.mapping || !options_.pieces.begin) return false;
  const Map& map = active().map();
  const auto known = std::ranges::count_if(
      detections, [&](const MarkerDetection& d) { return map.findPosed(d.id) != nullptr; });
  if (known != 1) {
    hangs_on_one_ = hangs_on_one_ && known == 0;
    return false;
  }
  hangs_on_one_ = hangs_on_one_ || mayBeElsewhere(time_ns);
  return hangs_on_one_ &&
         std::ranges::any_of(detections, [&](const MarkerDetection& d) { return isNobodys(d); });
}

// It was lost for so long that it may have been carried there.
bool PieceSet::mayBeElsewhere(std::int64_t time_ns) const {
  return last_pose_ns_ && secondsBetween(*last_pose_ns_, time_ns) > options_.pieces.carried_s;
}

// Valid until the next call.
std::span<const MarkerDetection> PieceSet::knownTo(int piece,
                                                   std::span<const MarkerDetection> detections) {
  const Map& map = pieces_.at(piece)->map();
  std::vector<MarkerDetection> known;
  std::ranges::copy_if(detections, std::back_inserter(known),
                       [&](const MarkerDetection& d) { return map.findPosed(d.id) != nullptr; });
  believed_ = std::move(known);
  return believed_;
}

// Null where there is none.
const MarkerDetection* PieceSet::otherPrint(int piece,
                                            std::span<const MarkerDetection> detections) const {
  const Piece& there = *pieces_.at(piece);
  if (!isAnotherPrint(there.map(), detections, there.jointParts())) return nullptr;
  return &*std::ranges::find_if(detections, [&](const MarkerDetection& detection) {
    return there.map().findPosed(detection.id) != nullptr;
  });
}

// After a while it is refused, as an id that is twice in one frame: nothing that hangs on it alone
// is sure.
void PieceSet::noteOtherPrint(int marker_id, std::int64_t time_ns) {
  ++counters_->other_prints;
  const PieceOptions::OtherPrint& options = options_.pieces.other_print;
  Suspicion& suspicion =
      suspicions_.try_emplace(marker_id, Suspicion{.frames = 0, .since_ns = time_ns}).first->second;
  ++suspicion.frames;
  const double age_s = 1e-9 * static_cast<double>(time_ns - suspicion.since_ns);
  if (suspicion.frames < options.frames || age_s < options.seconds) return;
  refuse(marker_id);
}

// It hangs twice.
void PieceSet::refuse(int marker_id) {
  suspicions_.erase(marker_id);
  owner_.erase(marker_id);
  ++counters_->refused_markers;
  forEach([&](Piece& piece) { piece.ban(marker_id); });
}

// A marker that a piece does not know is new to it, unless it is told.
void PieceSet::tellWhatOthersHave(int id, std::span<const MarkerDetection> detections) {
  if (!hasSeveral() || !options_.mapping) return;
  Piece& piece = *pieces_.at(id);
  for (const MarkerDetection& detection : detections) {
    const auto owner = owner_.find(detection.id);
    if (owner != owner_.end() && owner->second != id) {
      piece.setElsewhere(detection.id, true);
    } else if (const MapMarker* const known = piece.map().find(detection.id);
               known != nullptr && known->state == MarkerState::kElsewhere) {
      piece.setElsewhere(detection.id, false);
    }
  }
}

// Where the camera was lost: is it in another piece, or in a new one?
void PieceSet::goElsewhere(const FrameInput& frame, std::span<const MarkerDetection> detections,
                           StageObserver* observer, FrameResult* result) {
  for (const int id : piecesInView(detections)) {
    if (id == active_) continue;
    if (options_.mapping && otherPrint(id, detections) != nullptr) continue;
    tellWhatOthersHave(id, detections);
    const auto known = knownTo(id, detections);
    const bool hangs =
        options_.pieces.begin && known.size() == 1 && mayBeElsewhere(frame.time.monotonic_ns);
    FrameResult there = pieces_.at(id)->process(frame, hangs ? known : detections, Turn::kOthers,
                                                allowance(), observer);
    if (!there.pose) continue;
    active_ = id;
    hangs_on_one_ = hangs;
    ++counters_->relocalizations;
    there.map_changed = true;  // another one
    there.detections = detections;
    *result = there;
    return;
  }
  if (options_.mapping && options_.pieces.begin) begin(frame, detections, observer, result);
}

// Those with most markers in view first.
std::vector<int> PieceSet::piecesInView(std::span<const MarkerDetection> detections) const {
  std::map<int, int> markers;  // by piece
  for (const MarkerDetection& detection : detections) {
    const auto owner = owner_.find(detection.id);
    if (owner != owner_.end()) ++markers[owner->second];
  }
  std::vector<int> pieces;
  for (const auto& [piece, count] : markers) pieces.push_back(piece);
  std::ranges::stable_sort(pieces, std::ranges::greater(),
                           [&](int piece) { return markers.at(piece); });
  return pieces;
}

bool PieceSet::isPlaced(int marker_id) const {
  return std::ranges::any_of(pieces_, [&](const auto& piece) {
    return piece.second->map().findPosed(marker_id) != nullptr;
  });
}

// No piece has a place for it, or distrusts it.
bool PieceSet::isNobodys(const MarkerDetection& detection) const {
  return std::ranges::all_of(pieces_, [&](const auto& piece) {
    const MapMarker* const known = piece.second->map().find(detection.id);
    return known == nullptr || known->state == MarkerState::kUnresolved;
  });
}

void PieceSet::begin(const FrameInput& frame, std::span<const MarkerDetection> detections,
                     StageObserver* observer, FrameResult* result) {
  if (std::cmp_greater_equal(pieces_.size(), options_.pieces.max_pieces)) return;
  std::vector<MarkerDetection> unknown;
  std::ranges::copy_if(detections, std::back_inserter(unknown),
                       [&](const MarkerDetection& d) { return isNobodys(d); });
  if (unknown.empty()) return;
  if (!next_) {
    Map map;
    map.piece = next_id_;
    next_ = makePiece(std::move(map));
  }
  FrameResult there = next_->process(frame, unknown, Turn::kOthers, allowance(), observer);
  if (!there.pose) return;
  // From an earlier frame, too: what that saw may have got a place meanwhile.
  const bool all_new = std::ranges::all_of(next_->map().markers(), [&](const auto& entry) {
    return !entry.second.T_w_m || !isPlaced(entry.first);
  });
  if (!all_new) {
    next_.reset();
    return;
  }
  ++counters_->pieces_begun;
  if (!hasSeveral()) (void)claim(active_);  // who has which marker is of interest from here on
  active_ = next_id_++;
  pieces_.emplace(active_, std::move(next_));
  hangs_on_one_ = false;
  there.detections = detections;
  *result = there;
}

// What the piece has a place for is its own, and the others are told. Those of them that have views
// of what is new.
std::vector<int> PieceSet::claim(int piece) {
  std::vector<int> connected;
  std::erase_if(owner_, [&](const auto& entry) {
    return entry.second == piece && pieces_.at(piece)->map().findPosed(entry.first) == nullptr;
  });
  for (const auto& [id, marker] : pieces_.at(piece)->map().markers()) {
    if (!marker.T_w_m || !owner_.try_emplace(id, piece).second) continue;
    for (auto& [other, theirs] : pieces_) {
      if (other == piece || theirs->map().find(id) == nullptr) continue;
      theirs->setElsewhere(id, true);
      if (!theirs->map().viewsOf(id).empty()) connected.push_back(other);
    }
  }
  return connected;
}

void PieceSet::densify(std::span<const RecordedFrame> frames) {
  if (!options_.mapping) return;
  finishJoint();
  std::vector<RecordedFrame> now(frames.begin(), frames.end());
  for (RecordedFrame& frame : now) {
    PoseEstimate guess;
    guess.T_w_c = frame.T_w_c;
    guess.piece = frame.piece;
    guess = asOfNow(guess);
    frame.T_w_c = guess.T_w_c;
    frame.piece = guess.piece;
  }
  for (auto& [id, piece] : pieces_) {
    const Map& map = piece->map();
    std::vector<RecordedFrame> here;
    std::ranges::copy_if(now, std::back_inserter(here), [&](const RecordedFrame& frame) {
      return !hasSeveral() || frame.piece == id ||
             std::ranges::any_of(frame.detections, [&](const MarkerDetection& d) {
               return map.findPosed(d.id) != nullptr;
             });
    });
    for (const RecordedFrame& frame : here) tellWhatOthersHave(id, frame.detections);
    piece->batch().densify(here);
    if (hasSeveral()) (void)claim(id);
  }
}

Piece& PieceSet::largest() {
  return *std::ranges::max_element(pieces_, {}, [](const auto& entry) {
            return entry.second->map().keyframes().size();
          })->second;
}

void PieceSet::spreadLens(int from) {
  for (auto& [id, piece] : pieces_) {
    if (id != from) piece->undistortAgain();
  }
  for (JointTrial& trial : trials_) {
    trial.forEachMap([&](Map* map) {
      undistortAgain(*camera_, active().readout().readout_s, map, lens_->since_ns);
    });
  }
  search_.reset();
  abandonJoint();
  next_.reset();
}

// The piece with the most to say of the lens is asked, and the others see through what it found.
void PieceSet::optimizeWithIntrinsics() {
  finishJoint();
  Piece& asked = largest();
  asked.batch().optimizeWithIntrinsics();
  spreadLens(asked.map().piece);
  for (auto& [id, piece] : pieces_) {
    if (id != asked.map().piece) piece->batch().optimize();
  }
}

void PieceSet::estimateLens() {
  finishJoint();
  Piece& asked = largest();
  if (asked.estimateLens()) spreadLens(asked.map().piece);
}

}  // namespace waymark::slam
