#include "slam/marker_screening/marker_screening.h"

#include <algorithm>
#include <iterator>

#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// The marker's pose goes, and its views.
void ban(int marker_id, Map* map, Counters* counters) {
  map->ban(marker_id);
  map->removeViews(marker_id, map->viewsOf(marker_id));
  ++counters->refused_markers;
}

// The same; but it is estimated anew, and may turn out to be back where it was.
void quarantine(int marker_id, Map* map, Counters* counters) {
  map->quarantine(marker_id);
  map->removeViews(marker_id, map->viewsOf(marker_id));
  ++counters->quarantined_markers;
}

}  // namespace

std::string MarkerScreeningOptions::invalidReason() const {
  return firstUnmet({
      {isNotNegative(border_px), "the margin of clipped markers must not be negative"},
      {doubled_frames >= 1, "a doubled marker needs at least 1 frame"},
      {moved_frames >= 1 && moved_ns >= 0, "a moved marker needs at least 1 frame"},
      {max_moves >= 0, "the number of moves must not be negative"},
      {isNotNegative(same_place_m) && isNotNegative(same_place_rad),
       "the distances of the same place must not be negative"},
  });
}

std::span<const MarkerDetection> MarkerScreening::screen(
    std::span<const MarkerDetection> detections, const CameraModel& camera, const Map& map,
    Counters* counters) {
  const LeftOut left_out = sift(detections, camera, map, &usable_);
  counters->doubled_markers += left_out.doubled.size();
  counters->clipped_markers += left_out.clipped;
  for (const int id : left_out.doubled) ++doubled_[id];
  return usable_;
}

MarkerScreening::LeftOut MarkerScreening::sift(std::span<const MarkerDetection> detections,
                                               const CameraModel& camera, const Map& map,
                                               std::vector<MarkerDetection>* usable) const {
  LeftOut left_out;
  std::vector<int>& doubled = left_out.doubled;
  usable->clear();
  usable->reserve(detections.size());
  std::copy_if(detections.begin(), detections.end(), std::back_inserter(*usable),
               [&](const MarkerDetection& d) { return !markers_.isIgnored(d.id); });
  sortById(usable);
  for (std::size_t i = 1; i < usable->size(); ++i) {
    const int id = (*usable)[i].id;
    if (id == (*usable)[i - 1].id && (doubled.empty() || doubled.back() != id))
      doubled.push_back(id);
  }
  std::erase_if(*usable, [&](const MarkerDetection& d) {
    const MapMarker* marker = map.find(d.id);
    if (marker != nullptr && marker->state == MarkerState::kBanned) return true;
    if (std::binary_search(doubled.begin(), doubled.end(), d.id)) return true;
    const bool whole = std::all_of(d.pixels.begin(), d.pixels.end(), [&](const auto& corner) {
      return camera.inImage(corner, options_.border_px);
    });
    if (!whole) ++left_out.clipped;
    return !whole;
  });
  return left_out;
}

bool MarkerScreening::banDuplicates(Map* map, Counters* counters) {
  bool changed = false;
  for (const auto& [id, frames] : doubled_) {
    if (frames < options_.doubled_frames) continue;
    if (map->addMarker(id, markers_.sizeOf(id)).state == MarkerState::kBanned) continue;
    ban(id, map, counters);
    changed = true;
  }
  return changed;
}

void MarkerScreening::record(int marker_id, bool fits, std::int64_t time_ns) {
  auto known = std::ranges::lower_bound(disagreements_, marker_id, {}, &Disagreement::marker);
  const bool is_known = known != disagreements_.end() && known->marker == marker_id;
  if (fits) {
    if (is_known) disagreements_.erase(known);
    return;
  }
  if (!is_known) {
    known = disagreements_.insert(known, {.marker = marker_id, .since_ns = time_ns});
  }
  ++known->frames;
  known->until_ns = time_ns;
}

bool MarkerScreening::hasMoved(const Disagreement& disagreement, const Map& map) const {
  return disagreement.frames >= options_.moved_frames &&
         disagreement.until_ns - disagreement.since_ns >= options_.moved_ns &&
         map.findPosed(disagreement.marker) != nullptr;
}

void MarkerScreening::forgetMoves(Map* map) {
  disagreements_.clear();
  map->forgetMoves();
}

bool MarkerScreening::suspectsMoved(const Map& map) const {
  return std::ranges::any_of(disagreements_, [&](const Disagreement& disagreement) {
    return hasMoved(disagreement, map);
  });
}

bool MarkerScreening::quarantineMoved(Map* map, Counters* counters) {
  const auto moved = std::erase_if(disagreements_, [&](const Disagreement& disagreement) {
    if (!hasMoved(disagreement, *map)) return false;
    const std::size_t moves = map->find(disagreement.marker)->former_poses.size();
    const bool too_often = static_cast<int>(moves) >= options_.max_moves;
    (too_often ? ban : quarantine)(disagreement.marker, map, counters);
    return true;
  });
  return moved > 0;
}

void MarkerScreening::checkReturned(int marker_id, Map* map, Counters* counters) const {
  const MapMarker& marker = map->markers().at(marker_id);
  if (!marker.T_w_m) return;
  // The last former pose is where it has just left; it may have been moved only a little.
  const auto last =
      marker.former_poses.empty() ? marker.former_poses.end() : marker.former_poses.end() - 1;
  const bool returned =
      std::any_of(marker.former_poses.begin(), last, [&](const Transform& former) {
        return (former.p - marker.T_w_m->p).norm() < options_.same_place_m &&
               rotationDistance(former.R, marker.T_w_m->R) < options_.same_place_rad;
      });
  if (returned) ban(marker_id, map, counters);
}

}  // namespace waymark::slam
