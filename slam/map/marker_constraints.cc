#include "slam/map/marker_constraints.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <set>
#include <utility>

#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

std::string rangesReason(const std::string& name, const std::vector<IdRange>& ids) {
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (ids[i].first > ids[i].last) {
      return name + ": the range of ids " + std::to_string(ids[i].first) + "-" +
             std::to_string(ids[i].last) + " is empty";
    }
    for (std::size_t j = 0; j < i; ++j) {
      const int first = std::max(ids[i].first, ids[j].first);
      if (ids[i].contains(first) && ids[j].contains(first)) {
        return name + ": marker " + std::to_string(first) + " is named twice";
      }
    }
  }
  return {};
}

std::int64_t count(const std::vector<IdRange>& ids) {
  std::int64_t sum = 0;
  for (const IdRange& range : ids) sum += std::int64_t{range.last} - range.first + 1;
  return sum;
}

std::string positionsReason(const std::vector<SurveyedPosition>& positions) {
  std::set<int> known;
  for (const SurveyedPosition& position : positions) {
    const std::string name = "position " + std::to_string(position.id);
    if (!known.insert(position.id).second) return name + " is given twice";
    if (!position.p_w.allFinite()) return name + ": its coordinates must be finite";
    if (!isPositive(position.sigma_m)) return name + ": its sigma must be positive";
  }
  return {};
}

std::string planeReason(const std::string& name, const MarkerPlane& plane) {
  if (std::string reason = rangesReason(name, plane.ids); !reason.empty()) return reason;
  if (count(plane.ids) < 2) return name + ": a plane needs at least two markers";
  if (!isPositive(plane.sigma_m) || !isPositive(plane.sigma_rad)) {
    return name + ": its sigmas must be positive";
  }
  return {};
}

std::string distanceReason(const CornerDistance& distance) {
  const std::string name = distanceName(distance);
  for (const int corner : {distance.corner_a, distance.corner_b}) {
    if (corner < 0 || corner > 3) return name + ": corners are 0 to 3";
  }
  if (distance.id_a == distance.id_b) {
    return name + ": both corners are the same marker's, whose size is known";
  }
  if (!isPositive(distance.distance_m)) return name + ": a distance must be positive";
  if (!isPositive(distance.sigma_m)) return name + ": its sigma must be positive";
  return {};
}

std::string distancesReason(const std::vector<CornerDistance>& distances) {
  using Corner = std::pair<int, int>;
  std::set<std::pair<Corner, Corner>> known;
  for (const CornerDistance& distance : distances) {
    if (std::string reason = distanceReason(distance); !reason.empty()) return reason;
    const std::pair<Corner, Corner> ends = std::minmax(Corner(distance.id_a, distance.corner_a),
                                                       Corner(distance.id_b, distance.corner_b));
    if (!known.insert(ends).second) return distanceName(distance) + " is given twice";
  }
  return {};
}

}  // namespace

std::string MarkerConstraints::invalidReason() const {
  if (std::string reason = positionsReason(positions); !reason.empty()) return reason;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const std::string name = planeName(*this, i);
    if (std::string reason = planeReason(name, planes[i]); !reason.empty()) return reason;
  }
  if (std::string reason = rangesReason("upright", upright.ids); !reason.empty()) return reason;
  if (!isPositive(upright.sigma_rad)) return "upright: its sigma must be positive";
  if (std::string reason = distancesReason(distances); !reason.empty()) return reason;
  if (up_w && !(up_w->allFinite() && up_w->norm() > 0.0)) {
    return "up: the vertical must have a direction";
  }
  if (!isPositive(gate_sigmas)) return "the gate of constraints must be positive";
  return {};
}

std::string MarkerConstraints::findId(const std::function<bool(int)>& is) const {
  const auto inRanges = [&](const std::string& name, const std::vector<IdRange>& ids) {
    for (const IdRange& range : ids) {
      for (const int id : {range.first, range.last}) {
        if (is(id)) return name + ": marker " + std::to_string(id);
      }
    }
    return std::string();
  };
  for (const SurveyedPosition& position : positions) {
    if (is(position.id)) return "position " + std::to_string(position.id);
  }
  for (std::size_t i = 0; i < planes.size(); ++i) {
    if (std::string found = inRanges(planeName(*this, i), planes[i].ids); !found.empty()) {
      return found;
    }
  }
  if (std::string found = inRanges("upright", upright.ids); !found.empty()) return found;
  for (const CornerDistance& distance : distances) {
    for (const int id : {distance.id_a, distance.id_b}) {
      if (is(id)) return distanceName(distance) + ": marker " + std::to_string(id);
    }
  }
  return {};
}

std::string planeName(const MarkerConstraints& constraints, std::size_t plane) {
  const std::string& name = constraints.planes[plane].name;
  return "plane " + (name.empty() ? std::to_string(plane + 1) : "\"" + name + "\"");
}

std::string distanceName(const CornerDistance& distance) {
  const auto corner = [](int id, int k) { return std::to_string(id) + "/" + std::to_string(k); };
  return "distance " + corner(distance.id_a, distance.corner_a) + " to " +
         corner(distance.id_b, distance.corner_b);
}

}  // namespace waymark::slam
