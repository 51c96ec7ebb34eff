// How the pieces of a PieceSet are joined, and come apart again.
#include <algorithm>
#include <limits>
#include <utility>

#include "base/task.h"
#include "slam/map/world_reference.h"
#include "slam/piece_set.h"
#include "slam/pieces/other_print.h"

namespace waymark::slam {

// The active piece has changed: it may be connected with others now.
void PieceSet::noteConnected(std::span<const MarkerDetection> detections,
                             const FrameResult& result) {
  for (const int other : claim(active_)) want(active_, other);
  if (isAnchored(active_) && anchored_.insert(active_).second) {
    for (const int other : anchored_) want(active_, other);
  }
  if (!result.keyframe_added) return;
  for (const int other : piecesInView(detections)) want(active_, other);
}

void PieceSet::want(int a, int b) {
  if (a != b) wanted_.insert(std::minmax(a, b));
}

// As far as the frame's allowance goes.
void PieceSet::lookForJoint(const FrameInput& frame, FrameResult* result) {
  if (joining_) return joinInSlices(frame, result);
  if (!search_ && !wanted_.empty()) {
    const auto [a, b] = *wanted_.begin();
    wanted_.erase(wanted_.begin());
    if (find(a) == nullptr || find(b) == nullptr) return;
    const Pair pair = givesWay(b, a) ? Pair(a, b) : Pair(b, a);
    if (inOneSurvey(a, b)) {
      // Not while what moves the one into it is being told.
      if (result->map_changed) return want(a, b);
      beginJoint(pair, inSurvey(a, b));
      return joinInSlices(frame, result);
    }
    search_.emplace(Search{pair, JointSearch(pieces_.at(pair.first)->map(),
                                             pieces_.at(pair.second)->map(), options_.pieces)});
  }
  if (!search_) return;
  const auto [into, from] = search_->pair;
  const Piece& stays = *pieces_.at(into);
  if (!search_->frames.advance(stays.map(), pieces_.at(from)->map(), stays.jointParts(),
                               allowance())) {
    return;
  }
  const std::vector<JointView> views = search_->frames.views();
  search_.reset();
  const auto joint = decide(into, from, views);
  if (!joint) return;
  beginJoint({into, from}, *joint);
  joinInSlices(frame, result);
}

// The map that both become is made beside them, so that neither changes until it is done; and poses
// go on meanwhile.
void PieceSet::beginJoint(const Pair& pair, const PieceJoint& joint) {
  joining_ = std::make_unique<Joining>(pair, joint);
  for (const int id : {pair.first, pair.second}) pieces_.at(id)->hold(true);
}

// True when the map of both is made. What has changed in one of them all the same (a marker is
// banned, another lens is learned) makes it begin anew.
bool PieceSet::goOnJoining(double cost) {
  constexpr int kMostBeginnings = 4;  // then all of it is done at once
  Joining& joining = *joining_;
  const Map& into = pieces_.at(joining.pair.first)->map();
  const Map& from = pieces_.at(joining.pair.second)->map();
  const std::uint64_t changes = into.changes() + from.changes();
  if (!joining.task || joining.changes != changes) {
    joining.changes = changes;
    ++joining.begun;
    joining.task.emplace(
        [&](Budget* budget) { return joinMaps(into, from, joining.joint, budget); });
  }
  return joining.task->advance(joining.begun < kMostBeginnings ? cost : kUnlimited);
}

void PieceSet::joinInSlices(const FrameInput& frame, FrameResult* result) {
  if (!goOnJoining(std::max(work_, options_.pieces.join_cost_per_frame))) return;
  const int from = joining_->pair.second;
  const auto done = std::move(joining_);
  join(done->pair.first, from, done->joint, done->task->take());
  result->map_changed = true;
  if (active_ == from) follow(from, frame, result);
}

void PieceSet::finishJoint() {
  if (!joining_) return;
  (void)goOnJoining(kUnlimited);
  const auto [into, from] = joining_->pair;
  const auto done = std::move(joining_);
  join(into, from, done->joint, done->task->take());
  if (active_ == from) active_ = into;
}

// To be found out anew.
void PieceSet::abandonJoint() {
  if (!joining_) return;
  const auto [into, from] = joining_->pair;
  joining_.reset();
  for (const int id : {into, from}) pieces_.at(id)->hold(false);
  want(into, from);
}

bool PieceSet::isAnchored(int piece) const {
  return !options_.markers.origin_marker &&
         !firstKeyframeIsWorld(pieces_.at(piece)->map(), options_.markers);
}

// Both are surveyed, and so in one world: whatever frames say.
bool PieceSet::inOneSurvey(int a, int b) const { return isAnchored(a) && isAnchored(b); }

// As well as the survey says where either is.
PieceJoint PieceSet::inSurvey(int a, int b) const {
  PieceJoint joint;
  joint.ratio = std::numeric_limits<double>::infinity();
  for (const int piece : {a, b}) {
    joint.covariance += surveyCovariance(pieces_.at(piece)->map(), options_.markers);
  }
  return joint;
}

// The camera is in the piece that took the other one in.
void PieceSet::follow(int from, const FrameInput& frame, FrameResult* result) {
  active_ = joined_.at(from).into;
  if (!result->pose) return;
  result->pose = asOfNow(*result->pose);
  active().comeIn(*result->pose, frame.time.monotonic_ns);
}

// The older world stays, but one that is anchored before any other.
bool PieceSet::givesWay(int piece, int to) const {
  if (isAnchored(piece) != isAnchored(to)) return isAnchored(to);
  return to < piece;
}

// How they lie to each other, where that is beyond doubt.
std::optional<PieceJoint> PieceSet::decide(int into, int from,
                                           const std::vector<JointView>& views) const {
  if (views.empty()) return std::nullopt;
  std::vector<JointView> all = views;
  if (const auto refuting = refuting_.find({into, from}); refuting != refuting_.end()) {
    all.insert(all.end(), refuting->second.begin(), refuting->second.end());
  }
  auto joint = estimateJoint(all, options_.pieces);
  if (joint && overlap(pieces_.at(into)->map(), pieces_.at(from)->map(), joint->T_a_b)) {
    joint.reset();
  }
  if (!joint) ++counters_->pieces_undecided;
  return joint;
}

// A survey is not on trial; and what was joined with it cannot be taken out any more.
void PieceSet::putOnTrial(Map into, Map from, const PieceJoint& joint) {
  if (joint.views > 0) {
    trials_.emplace_back(std::move(into), std::move(from), joint);
    if (std::cmp_greater(trials_.size(), options_.pieces.trial.joints)) endTrial(0);
    return;
  }
  for (std::size_t k = trials_.size(); k-- > 0;) {
    if (trials_[k].into() == into.piece || trials_[k].into() == from.piece) endTrial(k);
  }
  gone_maps_.push_back(std::move(into));
  gone_maps_.push_back(std::move(from));
}

void PieceSet::endTrial(std::size_t trial) {
  const auto ended = trials_.begin() + static_cast<std::ptrdiff_t>(trial);
  gone_maps_.push_back(ended->takeInto());
  gone_maps_.push_back(ended->takeFrom());
  trials_.erase(ended);
}

void PieceSet::retire(std::unique_ptr<Piece> piece) {
  gone_maps_.push_back(piece->takeMap());
  gone_pieces_.push_back(std::move(piece));
}

// No more in a frame than it does not notice.
void PieceSet::letGoOfSome() {
  constexpr int kKeyframes = 200;
  if (!gone_pieces_.empty()) {
    if (gone_pieces_.back()->letGo(kKeyframes)) gone_pieces_.pop_back();
  } else if (!gone_maps_.empty()) {
    if (gone_maps_.back().letGo(kKeyframes)) gone_maps_.pop_back();
  }
}

// joined: what their maps become.
void PieceSet::join(int into, int from, const PieceJoint& joint, JoinedMap joined) {
  Piece& stays = *pieces_.at(into);
  std::unique_ptr<Piece> goes = std::move(pieces_.extract(from).mapped());
  stays.hold(false);
  putOnTrial(stays.adopt(std::move(joined)), goes->takeMap(), joint);
  retire(std::move(goes));
  joined_[from] = {into, joint.T_a_b};
  for (auto& [marker, owner] : owner_) {
    if (owner == from) owner = into;
  }
  std::set<std::pair<int, int>> wanted;
  const auto now = [&](int piece) { return piece == from ? into : piece; };
  wanted.swap(wanted_);
  for (const auto& [a, b] : wanted) want(now(a), now(b));
  if (search_ && (search_->pair.first == from || search_->pair.second == from)) search_.reset();
  anchored_.erase(from);
  ++counters_->pieces_joined;
  events_.push_back({PieceEvent::Kind::kJoined, from, into, joint.T_a_b, joint.covariance});
}

void PieceSet::watchTrials(const FrameInput& frame, std::span<const MarkerDetection> detections,
                           StageObserver* observer, FrameResult* result) {
  for (std::size_t k = 0; k < trials_.size(); ++k) {
    const JointTrial::Verdict verdict =
        trials_[k].watch(detections, frame.time.monotonic_ns, active().jointParts());
    if (verdict == JointTrial::Verdict::kOpen) continue;
    if (verdict == JointTrial::Verdict::kBelieved) {
      endTrial(k--);
      continue;
    }
    part(k);
    findCamera(frame, detections, observer, result);
    return;
  }
}

// In place of the piece of that id, if there is one.
void PieceSet::replace(int id, Map map) {
  auto restored = makePiece(std::move(map));
  std::unique_ptr<Piece>& piece = pieces_[id];
  if (piece) retire(std::move(piece));
  piece = std::move(restored);
}

// Both pieces are again what they were, and so are those that either was joined with since.
void PieceSet::part(std::size_t trial) {
  abandonJoint();
  refuting_[{trials_[trial].into(), trials_[trial].from()}] = trials_[trial].against();
  const std::optional<int> only = trials_[trial].onlyMarker();
  std::set<int> concerned;
  std::vector<std::size_t> undone;
  for (std::size_t k = trial; k < trials_.size(); ++k) {
    const JointTrial& joint = trials_[k];
    if (k > trial && !concerned.contains(joint.into()) && !concerned.contains(joint.from())) {
      continue;
    }
    concerned.insert({joint.into(), joint.from()});
    undone.push_back(k);
  }
  for (auto k = undone.rbegin(); k != undone.rend(); ++k) {
    JointTrial& joint = trials_[*k];
    const int into = joint.into();
    const int from = joint.from();
    events_.push_back(
        {PieceEvent::Kind::kParted, from, into, joint.joint().T_a_b, joint.joint().covariance});
    joined_.erase(from);
    std::erase_if(owner_, [&](const auto& entry) { return entry.second == into; });
    replace(into, joint.takeInto());
    replace(from, joint.takeFrom());
    (void)claim(into);
    (void)claim(from);
    ++counters_->pieces_parted;
    trials_.erase(trials_.begin() + static_cast<std::ptrdiff_t>(*k));
  }
  search_.reset();
  wanted_.clear();
  anchored_.clear();
  if (only) refuse(*only);
}

// After a joint was undone: which of the pieces is it in?
void PieceSet::findCamera(const FrameInput& frame, std::span<const MarkerDetection> detections,
                          StageObserver* observer, FrameResult* result) {
  result->pose.reset();
  result->state = TrackingState::kRelocalizing;
  result->reason = NoPoseReason::kMarkersDoNotFit;
  active_ = pieces_.begin()->first;
  for (const int id : piecesInView(detections)) {
    if (otherPrint(id, detections) != nullptr) continue;
    tellWhatOthersHave(id, detections);
    FrameResult there =
        pieces_.at(id)->process(frame, detections, Turn::kOthers, allowance(), observer);
    if (!there.pose) continue;
    active_ = id;
    *result = there;
    result->detections = detections;
    break;
  }
  result->map_changed = true;
}

bool PieceSet::joinAll() {
  if (!options_.mapping) return false;
  finishJoint();
  forEach([](Piece& piece) { (void)piece.batch(); });  // what is under way is done
  trials_.clear();                                     // no frame comes that could refute any
  bool any = false;
  for (bool again = true; again;) {
    again = false;
    for (auto a = pieces_.begin(); a != pieces_.end() && !again; ++a) {
      for (auto b = std::next(a); b != pieces_.end() && !again; ++b) {
        const int into = givesWay(b->first, a->first) ? a->first : b->first;
        const int from = into == a->first ? b->first : a->first;
        const Piece& stays = *pieces_.at(into);
        const Map& theirs = pieces_.at(from)->map();
        JointSearch search(stays.map(), theirs, options_.pieces);
        (void)search.advance(stays.map(), theirs, stays.jointParts(), kUnlimited);
        const auto joint = inOneSurvey(into, from) ? std::optional(inSurvey(into, from))
                                                   : decide(into, from, search.views());
        if (!joint) continue;
        join(into, from, *joint, runToCompletion([&](Budget* budget) {
               return joinMaps(stays.map(), theirs, *joint, budget);
             }));
        if (active_ == from) active_ = into;
        any = again = true;
      }
    }
  }
  trials_.clear();
  return any;
}

}  // namespace waymark::slam
