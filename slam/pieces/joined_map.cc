#include "slam/pieces/joined_map.h"

#include <optional>
#include <utility>

#include "slam/geometry/turned_covariance.h"

namespace waymark::slam {
namespace {

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kCopyMarker = 0.4;
constexpr double kMoveMarker = 0.8;
constexpr double kCopyKeyframe = 0.4;
constexpr double kNoteView = 0.02;

double costOf(const Keyframe& keyframe) {
  return kCopyKeyframe +
         kNoteView * static_cast<double>(keyframe.detections.size() + keyframe.links.size());
}

// What both know it is known as already.
bool comesIn(const MapMarker& theirs, const MapMarker* known) {
  if (known == nullptr) return true;
  if (known->T_w_m || known->state == MarkerState::kBanned) return false;
  return theirs.T_w_m || theirs.state == MarkerState::kBanned;
}

MapMarker moved(const MapMarker& theirs, const PieceJoint& joint) {
  const Transform& T = joint.T_a_b;
  MapMarker marker = theirs;
  if (theirs.T_w_m) marker.T_w_m = T * *theirs.T_w_m;
  if (theirs.other_T_w_m) marker.other_T_w_m = T * *theirs.other_T_w_m;
  marker.covariance = turnedCovariance(T.R, theirs.covariance);
  if (theirs.T_w_m) {
    // What is not known of the joint moves and turns all of the piece.
    const Matrix6d J = rigidTransport(marker.T_w_m->p - T.p);
    marker.world_covariance =
        turnedCovariance(T.R, theirs.world_covariance) + J * joint.covariance * J.transpose();
  }
  for (Transform& former : marker.former_poses) former = T * former;
  return marker;
}

Task<Done> copyInto(const Map& from, Map* map, Budget* budget) {
  for (const auto& [id, marker] : from.markers()) {
    co_await budget->spend(kCopyMarker);
    (void)map->putMarker(marker);
  }
  for (const auto& [id, keyframe] : from.keyframes()) {
    co_await budget->spend(costOf(keyframe));
    (void)map->addKeyframe(keyframe);
  }
  co_return Done{};
}

}  // namespace

Task<JoinedMap> joinMaps(const Map& into, const Map& from, const PieceJoint& joint,
                         Budget* budget) {
  JoinedMap joined;
  joined.map.dictionary = into.dictionary;
  joined.map.piece = into.piece;
  (void)co_await copyInto(into, &joined.map, budget);
  joined.map.goOnFrom(into);
  for (const auto& [id, theirs] : from.markers()) {
    co_await budget->spend(kMoveMarker);
    if (!comesIn(theirs, joined.map.find(id))) continue;
    (void)joined.map.putMarker(moved(theirs, joint));
    if (theirs.state == MarkerState::kBanned) {
      joined.map.removeViews(id, joined.map.viewsOf(id));
    }
  }
  for (const auto& [id, theirs] : from.keyframes()) {
    co_await budget->spend(costOf(theirs));
    Keyframe keyframe = theirs;
    keyframe.id = -1;
    keyframe.T_w_c = joint.T_a_b * theirs.T_w_c;
    joined.newest = joined.map.addKeyframe(std::move(keyframe));
  }
  co_return joined;
}

}  // namespace waymark::slam
