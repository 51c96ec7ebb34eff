#include "tools/maps/map_merge.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "io/maps/old_map.h"
#include "io/text/number_text.h"
#include "slam/camera/undistort_map.h"
#include "slam/geometry/align_points.h"

namespace waymark::tools {
namespace {

using Corners = std::array<Eigen::Vector3d, 4>;

struct SharedMarker {
  int id = -1;
  Corners in_a;
  Corners in_b;
};

std::vector<SharedMarker> sharedMarkers(const slam::Map& a, const slam::Map& b) {
  std::vector<SharedMarker> shared;
  for (const auto& [id, marker] : b.markers()) {
    const slam::MapMarker* other = a.findPosed(id);
    if (other == nullptr || !marker.T_w_m) continue;
    shared.push_back({id, other->cornersInWorld(), marker.cornersInWorld()});
  }
  return shared;
}

double largestDistance(const SharedMarker& marker, const slam::Transform& T_a_b) {
  double largest = 0.0;
  for (std::size_t k = 0; k < 4; ++k) {
    largest = std::max(largest, (T_a_b * marker.in_b[k] - marker.in_a[k]).norm());
  }
  return largest;
}

slam::Transform align(const std::vector<SharedMarker>& shared, const std::vector<std::size_t>& by) {
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (const std::size_t i : by) {
    from.insert(from.end(), shared[i].in_b.begin(), shared[i].in_b.end());
    to.insert(to.end(), shared[i].in_a.begin(), shared[i].in_a.end());
  }
  return slam::alignPoints(from, to);
}

// Indices of the markers that are where the alignment puts them.
std::vector<std::size_t> agreeing(const std::vector<SharedMarker>& shared,
                                  const slam::Transform& T_a_b, double tolerance_m) {
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < shared.size(); ++i) {
    if (largestDistance(shared[i], T_a_b) <= tolerance_m) indices.push_back(i);
  }
  return indices;
}

// The alignment by which most markers agree. Every marker is tried together with some others, near
// and far in the list of ids; then those that agree are aligned together.
std::vector<std::size_t> largestConsensus(const std::vector<SharedMarker>& shared,
                                          double tolerance_m) {
  constexpr std::size_t kPartners = 20;
  std::vector<std::size_t> best;
  const std::size_t stride = 1 + shared.size() / kPartners;
  for (std::size_t i = 0; i < shared.size(); ++i) {
    for (std::size_t j = i + 1; j < shared.size(); j += stride) {
      std::vector<std::size_t> by = {i, j};
      for (int round = 0; round < 3; ++round) {
        std::vector<std::size_t> now = agreeing(shared, align(shared, by), tolerance_m);
        if (now.size() > best.size()) best = now;
        if (now.size() < 2 || now == by) break;
        by = std::move(now);
      }
    }
  }
  return best;
}

std::string listed(const std::vector<int>& ids) {
  std::string text;
  for (const int id : ids) text += (text.empty() ? "" : ", ") + std::to_string(id);
  return text.empty() ? "none" : text;
}

Status checkSameMarkers(const slam::Map& a, const slam::Map& b) {
  if (a.dictionary != b.dictionary) {
    return Error{"the maps have different dictionaries: " + a.dictionary + ", " + b.dictionary};
  }
  for (const auto& [id, marker] : b.markers()) {
    const slam::MapMarker* other = a.find(id);
    if (other == nullptr || std::abs(other->size_m - marker.size_m) <= 1e-6 * marker.size_m) {
      continue;
    }
    return Error{"marker " + std::to_string(id) + " has a side of " + io::roundTrip(other->size_m) +
                 " m in one map, " + io::roundTrip(marker.size_m) + " m in the other"};
  }
  return success();
}

Result<MergeReport> alignMaps(const slam::Map& a, const slam::Map& b, const MergeOptions& options) {
  const std::vector<SharedMarker> shared = sharedMarkers(a, b);
  const std::vector<std::size_t> consensus = largestConsensus(shared, options.tolerance_m);
  MergeReport report;
  if (!consensus.empty()) report.T_a_b = align(shared, consensus);
  double squares_m2 = 0.0;
  for (std::size_t i = 0; i < shared.size(); ++i) {
    const bool agrees = std::binary_search(consensus.begin(), consensus.end(), i);
    (agrees ? report.agreeing : report.disagreeing).push_back(shared[i].id);
    for (std::size_t k = 0; agrees && k < 4; ++k) {
      squares_m2 += (report.T_a_b * shared[i].in_b[k] - shared[i].in_a[k]).squaredNorm();
    }
  }
  const std::size_t agree = report.agreeing.size();
  if (agree < static_cast<std::size_t>(options.min_agreeing) ||
      agree <= report.disagreeing.size()) {
    return Error{"too few shared markers agree within " + io::roundTrip(options.tolerance_m) +
                 " m: of " + std::to_string(shared.size()) + " agree: " + listed(report.agreeing) +
                 "; disagree: " + listed(report.disagreeing)};
  }
  report.rms_m = std::sqrt(squares_m2 / (4.0 * static_cast<double>(agree)));
  return report;
}

void dropViews(int id, slam::Map* map) {
  map->removeViews(id, map->viewsOf(id));
  map->removeLinksTo(id);
}

// Whose views of a marker are worth keeping, and whose idea of it.
void mergeMarker(const slam::MapMarker& theirs, const std::vector<int>& disagreeing,
                 slam::Map* ours, slam::Map* b) {
  const int id = theirs.id;
  const slam::MapMarker* known = ours->find(id);
  if (known == nullptr) {
    (void)ours->putMarker(theirs);
    return;
  }
  const auto trusted = [](slam::MarkerState state) {
    return state == slam::MarkerState::kMapped || state == slam::MarkerState::kUnresolved;
  };
  const bool disagrees = std::binary_search(disagreeing.begin(), disagreeing.end(), id);
  if (disagrees || known->state == slam::MarkerState::kBanned || !trusted(theirs.state)) {
    dropViews(id, b);
  } else if (!known->T_w_m && theirs.T_w_m) {
    if (!trusted(known->state)) dropViews(id, ours);  // of where it hung before
    (void)ours->putMarker(theirs);
  }
}

// Behind ours, under new numbers. One that says nothing is left out.
void addKeyframes(const slam::Map& theirs, slam::Map* ours) {
  for (const auto& [id, keyframe] : theirs.keyframes()) {
    slam::Keyframe renumbered = keyframe;
    renumbered.id = -1;
    std::erase_if(renumbered.links, [&](const slam::MarkerLink& link) {
      return ours->findPosed(link.marker) == nullptr;
    });
    if (renumbered.detections.empty()) continue;
    (void)ours->addKeyframe(std::move(renumbered));
  }
}

}  // namespace

Result<MergeReport> mergeMaps(io::MapFile* a, const io::MapFile& b, const MergeOptions& options) {
  if (const Status same = checkSameMarkers(a->map, b.map); !same) return same.error();
  Result<MergeReport> report = alignMaps(a->map, b.map, options);
  if (!report) return report;
  io::MapFile moved = b;
  if (a->camera && moved.camera) {
    const auto changed = io::changeCamera(*a->camera, &moved);
    if (!changed) return changed.error();
    if (*changed) report->warnings.push_back(**changed);
  }
  moved.map.moveWorld(report->T_a_b);
  const auto markers = moved.map.markers();
  for (const auto& [id, marker] : markers) {
    if (marker.T_w_m && a->map.findPosed(id) == nullptr) report->added.push_back(id);
    mergeMarker(marker, report->disagreeing, &a->map, &moved.map);
  }
  addKeyframes(moved.map, &a->map);
  if (!a->camera) a->camera = moved.camera;
  if (a->readout_s == 0.0) a->readout_s = moved.readout_s;  // one camera, one shutter
  if (a->camera && a->readout_s != 0.0) {
    slam::undistortAgain(slam::CameraModel(*a->camera), a->readout_s, &a->map);
  }
  a->has_checksum = a->has_checksum && b.has_checksum;
  return report;
}

}  // namespace waymark::tools
