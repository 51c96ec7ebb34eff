#include "slam/map/map.h"

#include <algorithm>
#include <utility>

#include "base/sorted.h"
#include "slam/geometry/turned_covariance.h"

namespace waymark::slam {
namespace {

void withoutPose(MarkerState state, MapMarker* marker) {
  marker->state = state;
  marker->T_w_m.reset();
  marker->other_T_w_m.reset();
  marker->world_covariance.setZero();
}

}  // namespace

bool MapMarker::isSound() const {
  return (state == MarkerState::kMapped) == T_w_m.has_value() && (T_w_m || !other_T_w_m);
}

std::array<Eigen::Vector3d, 4> MapMarker::cornersInWorld() const {
  std::array<Eigen::Vector3d, 4> corners = markerCorners(size_m);
  if (height_m > 0.0) {
    for (Eigen::Vector3d& corner : corners) corner.y() *= height_m / size_m;
  }
  for (Eigen::Vector3d& corner : corners) corner = *T_w_m * corner;
  return corners;
}

const MarkerDetection* Keyframe::find(int marker_id) const {
  const auto found = std::ranges::lower_bound(detections, marker_id, {}, &MarkerDetection::id);
  return found != detections.end() && found->id == marker_id ? &*found : nullptr;
}

bool Map::empty() const {
  return keyframes_.empty() &&
         std::none_of(markers_.begin(), markers_.end(),
                      [](const auto& entry) { return entry.second.T_w_m.has_value(); });
}

const MapMarker* Map::find(int marker_id) const {
  const auto found = markers_.find(marker_id);
  return found == markers_.end() ? nullptr : &found->second;
}

const MapMarker* Map::findPosed(int marker_id) const {
  const MapMarker* marker = find(marker_id);
  return marker != nullptr && marker->T_w_m ? marker : nullptr;
}

std::span<const KeyframeId> Map::viewsOf(int marker_id) const {
  const auto found = views_.find(marker_id);
  if (found == views_.end()) return {};
  return found->second;
}

std::span<const KeyframeId> Map::linkedFrom(int marker_id) const {
  const auto found = linked_from_.find(marker_id);
  if (found == linked_from_.end()) return {};
  return found->second;
}

std::vector<KeyframeId> Map::neighbours(KeyframeId keyframe) const {
  std::vector<KeyframeId> neighbours{keyframe};
  for (const MarkerDetection& detection : keyframes_.at(keyframe).detections) {
    const auto views = viewsOf(detection.id);
    neighbours.insert(neighbours.end(), views.begin(), views.end());
  }
  sortUnique(&neighbours);
  return neighbours;
}

std::vector<int> Map::markersSeenFrom(std::span<const KeyframeId> keyframes) const {
  std::vector<int> markers;
  for (const KeyframeId id : keyframes) {
    for (const MarkerDetection& detection : keyframes_.at(id).detections) {
      markers.push_back(detection.id);
    }
  }
  sortUnique(&markers);
  return markers;
}

const MapMarker& Map::addMarker(int marker_id, double size_m) {
  MapMarker& marker = markers_[marker_id];
  if (marker.id < 0) {
    ++changes_;
    marker.id = marker_id;
    marker.size_m = size_m;
  }
  return marker;
}

const MapMarker& Map::addPicture(const PicturePrint& print) {
  const int id = pictureId(print.name);
  ++changes_;
  (void)addMarker(id, print.width_m);
  MapMarker& marker = markers_.at(id);
  marker.size_m = print.width_m;
  marker.height_m = print.height_m;
  marker.picture = print.name;
  return marker;
}

bool Map::putMarker(const MapMarker& marker) {
  if (!marker.isSound()) return false;
  ++changes_;
  markers_[marker.id] = marker;
  return true;
}

void Map::place(int marker_id, const Transform& T_w_m, const std::optional<Transform>& other,
                const Matrix6d& covariance) {
  ++changes_;
  MapMarker& marker = markers_.at(marker_id);
  marker.state = MarkerState::kMapped;
  marker.T_w_m = T_w_m;
  marker.other_T_w_m = other;
  marker.covariance = covariance;
}

void Map::quarantine(int marker_id) {
  ++changes_;
  MapMarker& marker = markers_.at(marker_id);
  if (marker.T_w_m) marker.former_poses.push_back(*marker.T_w_m);
  withoutPose(MarkerState::kQuarantined, &marker);
  removeLinksTo(marker_id);
}

void Map::forgetMoves() {
  ++changes_;
  for (auto& [id, marker] : markers_) {
    const bool banned_for_moves =
        marker.state == MarkerState::kBanned && !marker.former_poses.empty();
    if (banned_for_moves || marker.state == MarkerState::kQuarantined) {
      marker.state = MarkerState::kUnresolved;
    }
    marker.former_poses.clear();
  }
}

void Map::ban(int marker_id) {
  ++changes_;
  withoutPose(MarkerState::kBanned, &markers_.at(marker_id));
  removeLinksTo(marker_id);
}

void Map::setElsewhere(int marker_id, bool elsewhere) {
  ++changes_;
  withoutPose(elsewhere ? MarkerState::kElsewhere : MarkerState::kUnresolved,
              &markers_.at(marker_id));
}

KeyframeId Map::addKeyframe(Keyframe keyframe) {
  ++changes_;
  keyframe.id = std::max(keyframe.id, next_keyframe_);
  next_keyframe_ = keyframe.id + 1;
  if (!std::ranges::is_sorted(keyframe.detections, {}, &MarkerDetection::id)) {
    keyframe.detections.change([](auto* detections) { sortById(detections); });
  }
  for (const MarkerDetection& detection : keyframe.detections) {
    views_[detection.id].push_back(keyframe.id);
    ++view_count_;
  }
  const KeyframeId id = keyframe.id;
  const std::vector<MarkerLink> links = std::exchange(keyframe.links, {});
  keyframes_.emplace_hint(keyframes_.end(), id, std::move(keyframe));
  for (const MarkerLink& link : links) {
    if (markers_.contains(link.marker)) addLink(id, link);
  }
  return id;
}

void Map::setKeyframePoses(std::span<const KeyframePose> poses) {
  ++changes_;
  // From one to the next, where that is not further than looking it up.
  constexpr int kSteps = 8;
  auto known = keyframes_.begin();
  for (const KeyframePose& pose : poses) {
    for (int i = 0; i < kSteps && known != keyframes_.end() && known->first < pose.id; ++i) ++known;
    if (known != keyframes_.end() && known->first < pose.id) {
      known = keyframes_.lower_bound(pose.id);
    }
    if (known == keyframes_.end()) return;
    if (known->first == pose.id) known->second.T_w_c = pose.T_w_c;
  }
}

void Map::removeKeyframe(KeyframeId id) {
  ++changes_;
  for (const MarkerDetection& detection : keyframes_.at(id).detections) {
    view_count_ -= std::erase(views_[detection.id], id);
  }
  for (const MarkerLink& link : keyframes_.at(id).links) std::erase(linked_from_[link.marker], id);
  keyframes_.erase(id);
}

void Map::addLink(KeyframeId id, const MarkerLink& link) {
  ++changes_;
  std::vector<MarkerLink>& links = keyframes_.at(id).links;
  const auto known = std::ranges::lower_bound(links, link.marker, {}, &MarkerLink::marker);
  if (known != links.end() && known->marker == link.marker) {
    *known = link;
    return;
  }
  links.insert(known, link);
  linked_from_[link.marker].push_back(id);
}

void Map::removeLinksTo(int marker_id) {
  const auto from = linked_from_.extract(marker_id);
  if (!from) return;
  ++changes_;
  for (const KeyframeId id : from.mapped()) {
    std::erase_if(keyframes_.at(id).links,
                  [&](const MarkerLink& link) { return link.marker == marker_id; });
  }
}

void Map::addView(KeyframeId id, const MarkerDetection& detection) {
  ++changes_;
  keyframes_.at(id).detections.change([&](auto* detections) {
    const auto behind =
        std::ranges::upper_bound(*detections, detection.id, {}, &MarkerDetection::id);
    detections->insert(behind, detection);
  });
  std::vector<KeyframeId>& views = views_[detection.id];
  views.insert(std::upper_bound(views.begin(), views.end(), id), id);
  ++view_count_;
}

void Map::replaceView(KeyframeId id, const MarkerDetection& detection) {
  ++changes_;
  keyframes_.at(id).detections.change([&](auto* detections) {
    *std::ranges::lower_bound(*detections, detection.id, {}, &MarkerDetection::id) = detection;
  });
}

void Map::removeViews(int marker_id, std::span<const KeyframeId> keyframes) {
  ++changes_;
  const std::vector<KeyframeId> gone(keyframes.begin(), keyframes.end());  // may be viewsOf()
  for (const KeyframeId id : gone) {
    keyframes_.at(id).detections.change([&](auto* detections) {
      std::erase_if(*detections, [&](const MarkerDetection& d) { return d.id == marker_id; });
    });
    view_count_ -= std::erase(views_[marker_id], id);
  }
}

void Map::moveWorld(const Transform& T_v_w) {
  beginEpoch();
  for (auto& [id, marker] : markers_) {
    if (marker.T_w_m) marker.T_w_m = T_v_w * *marker.T_w_m;
    if (marker.other_T_w_m) marker.other_T_w_m = T_v_w * *marker.other_T_w_m;
    marker.covariance = turnedCovariance(T_v_w.R, marker.covariance);
    marker.world_covariance = turnedCovariance(T_v_w.R, marker.world_covariance);
    for (Transform& former : marker.former_poses) former = T_v_w * former;
  }
  for (auto& [id, keyframe] : keyframes_) keyframe.T_w_c = T_v_w * keyframe.T_w_c;
}

void Map::goOnFrom(const Map& map) {
  ++changes_;
  epoch_ = map.epoch_;
  next_keyframe_ = std::max(next_keyframe_, map.next_keyframe_);
}

bool Map::letGo(int count) {
  ++changes_;
  for (; count > 0 && !keyframes_.empty(); --count) keyframes_.erase(keyframes_.begin());
  for (; count > 0 && !markers_.empty(); --count) markers_.erase(markers_.begin());
  for (; count > 0 && !views_.empty(); --count) views_.erase(views_.begin());
  return keyframes_.empty() && markers_.empty() && views_.empty();
}

}  // namespace waymark::slam
