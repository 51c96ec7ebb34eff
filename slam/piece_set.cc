#include "slam/piece_set.h"

#include <algorithm>
#include <utility>

#include "slam/batch_mapper.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/map/world_reference.h"

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
  const double readout_s = pieces_.empty() ? options_.shutter.learned_s : active().readout_s();
  return std::make_unique<Piece>(PieceParts{options_, camera_, lens_, counters_, readout_s},
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
  tellWhatOthersHave(active_, detections);
  const int lens_changes = lens_->changes;
  FrameResult result = active().process(frame, detections, Turn::kOwn, observer);
  if (lens_->changes != lens_changes) spreadLens(active_);
  if (!result.pose && !active().map().empty()) goElsewhere(frame, detections, observer, &result);
  if (hasSeveral() && options_.mapping && (result.map_changed || result.keyframe_added)) {
    connect(frame, detections, &result);
  }
  return result;
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
    tellWhatOthersHave(id, detections);
    FrameResult there = pieces_.at(id)->process(frame, detections, Turn::kOthers, observer);
    if (!there.pose) continue;
    active_ = id;
    ++counters_->relocalizations;
    there.map_changed = true;  // another one
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
  FrameResult there = next_->process(frame, unknown, Turn::kOthers, observer);
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

// The active piece has changed: it may be connected with others now.
void PieceSet::connect(const FrameInput& frame, std::span<const MarkerDetection> detections,
                       FrameResult* result) {
  std::vector<int> connected = claim(active_);
  if (result->keyframe_added) {
    for (const int id : piecesInView(detections)) connected.push_back(id);
  }
  std::ranges::sort(connected);
  const auto twice = std::ranges::unique(connected);
  connected.erase(twice.begin(), twice.end());
  std::erase(connected, active_);
  for (const int other : connected) {
    const int left = tryToJoin(active_, other);
    if (left < 0) continue;
    result->map_changed = true;
    if (left == active_) continue;
    active_ = left;
    if (!result->pose) continue;
    result->pose = asOfNow(*result->pose);
    active().comeIn(*result->pose, frame.time.monotonic_ns);
  }
}

// The older world stays, but one that is anchored before any other.
bool PieceSet::givesWay(int piece, int to) const {
  const auto anchored = [&](int id) {
    return !firstKeyframeIsWorld(pieces_.at(id)->map(), options_.markers);
  };
  if (!options_.markers.origin_marker && anchored(piece) != anchored(to)) return anchored(to);
  return to < piece;
}

int PieceSet::tryToJoin(int a, int b) {
  const int into = givesWay(b, a) ? a : b;
  const int from = into == a ? b : a;
  Piece& stays = *pieces_.at(into);
  Piece& goes = *pieces_.at(from);
  const auto views = connectingViews(stays.map(), goes.map(), stays.jointParts());
  if (views.empty()) return -1;
  const auto joint = estimateJoint(views, options_.pieces);
  if (!joint) {
    ++counters_->pieces_undecided;
    return -1;
  }
  stays.absorb(goes.map(), *joint);
  joined_[from] = {into, joint->T_a_b};
  for (auto& [marker, owner] : owner_) {
    if (owner == from) owner = into;
  }
  pieces_.erase(from);
  ++counters_->pieces_joined;
  return into;
}

void PieceSet::densify(std::span<const RecordedFrame> frames) {
  if (!options_.mapping) return;
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

bool PieceSet::joinAll() {
  if (!options_.mapping) return false;
  forEach([](Piece& piece) { (void)piece.batch(); });  // what is under way is done
  bool any = false;
  for (bool again = true; again;) {
    again = false;
    for (auto a = pieces_.begin(); a != pieces_.end() && !again; ++a) {
      for (auto b = std::next(a); b != pieces_.end() && !again; ++b) {
        const int first = a->first;
        const int second = b->first;
        const int left = tryToJoin(first, second);
        if (left < 0) continue;
        if (active_ == first || active_ == second) active_ = left;
        any = again = true;
      }
    }
  }
  return any;
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
  next_.reset();
}

// The piece with the most to say of the lens is asked, and the others see through what it found.
void PieceSet::optimizeWithIntrinsics() {
  Piece& asked = largest();
  asked.batch().optimizeWithIntrinsics();
  spreadLens(asked.map().piece);
  for (auto& [id, piece] : pieces_) {
    if (id != asked.map().piece) piece->batch().optimize();
  }
}

void PieceSet::estimateLens() {
  Piece& asked = largest();
  if (asked.estimateLens()) spreadLens(asked.map().piece);
}

}  // namespace waymark::slam
