#include "slam/map/marker_options.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace waymark::slam {
namespace {

bool isLength(double metres) { return std::isfinite(metres) && metres > 0.0; }

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
  return {};
}

}  // namespace waymark::slam
