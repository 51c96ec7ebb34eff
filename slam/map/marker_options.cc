#include "slam/map/marker_options.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace waymark::slam {
namespace {

bool isLength(double metres) { return std::isfinite(metres) && metres > 0.0; }

// Of constraints that are sound in themselves, and of no use here.
std::string constraintsReason(const MarkerOptions& markers) {
  const MarkerConstraints& constraints = markers.constraints;
  if (std::string reason = constraints.invalidReason(); !reason.empty()) return reason;
  for (const SurveyedPosition& position : constraints.positions) {
    if (std::ranges::find(markers.anchors, position.id, &Anchor::id) != markers.anchors.end()) {
      return "position " + std::to_string(position.id) + " is an anchor, too; one of them will do";
    }
  }
  constexpr std::size_t kFewest = 3;
  if (markers.anchors.empty() && !constraints.positions.empty() &&
      constraints.positions.size() < kFewest) {
    return "positions without orientation fix the world from three on; or give an anchor";
  }
  const bool surveyed =
      markers.origin_marker || !markers.anchors.empty() || !constraints.positions.empty();
  if (constraints.up_w && !surveyed) {
    return "up is the vertical in a surveyed world; give anchors, positions or an origin marker";
  }
  const std::string ignored =
      constraints.findId([&markers](int id) { return markers.isIgnored(id); });
  return ignored.empty() ? ignored : ignored + " is among the ignored ids";
}

}  // namespace

double MarkerOptions::sizeOf(int id) const {
  const auto found = std::find_if(other_sizes.begin(), other_sizes.end(),
                                  [&](const Size& other) { return other.ids.contains(id); });
  return found == other_sizes.end() ? size_m : found->size_m;
}

bool MarkerOptions::isIgnored(int id) const {
  return std::any_of(ignored.begin(), ignored.end(),
                     [&](const IdRange& range) { return range.contains(id); });
}

std::string MarkerOptions::invalidReason() const {
  if (!isLength(size_m)) return "the marker size must be a positive number of metres";
  for (const Size& other : other_sizes) {
    const std::string ids = std::to_string(other.ids.first) + "-" + std::to_string(other.ids.last);
    if (!isLength(other.size_m)) {
      return "the size of the markers " + ids + " must be a positive number of metres";
    }
    if (other.ids.first > other.ids.last) return "the range of ids " + ids + " is empty";
  }
  for (const IdRange& range : ignored) {
    if (range.first > range.last) {
      return "the range of ignored ids " + std::to_string(range.first) + "-" +
             std::to_string(range.last) + " is empty";
    }
  }
  if (origin_marker && !anchors.empty()) {
    return "anchors and an origin marker both fix the world; only one of them can";
  }
  if (origin_marker && !constraints.positions.empty()) {
    return "surveyed positions and an origin marker both fix the world; only one of them can";
  }
  std::set<int> anchored;
  for (const Anchor& anchor : anchors) {
    const std::string name = "anchor " + std::to_string(anchor.id);
    if (!anchored.insert(anchor.id).second) return name + " is given twice";
    if (!isLength(anchor.sigma_m) || !isLength(anchor.sigma_rad)) {
      return name + ": its sigmas must be positive";
    }
    if (isIgnored(anchor.id)) return name + " is among the ignored ids";
  }
  if (origin_marker && isIgnored(*origin_marker)) {
    return "the origin marker is among the ignored ids";
  }
  return constraintsReason(*this);
}

}  // namespace waymark::slam
