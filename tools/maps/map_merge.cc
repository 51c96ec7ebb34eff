#include "tools/maps/map_merge.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <optional>
#include <utility>

#include "io/maps/old_map.h"
#include "io/text/number_text.h"
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

// Whose views of a marker are worth keeping, and whose idea of it. Those of one that hangs in
// another piece are: they connect the two.
void mergeMarker(const slam::MapMarker& theirs, const std::vector<int>& disagreeing,
                 slam::Map* ours, slam::Map* b) {
  const int id = theirs.id;
  const slam::MapMarker* known = ours->find(id);
  if (known == nullptr) {
    (void)ours->putMarker(theirs);
    return;
  }
  const auto trusted = [](slam::MarkerState state) {
    return state == slam::MarkerState::kMapped || state == slam::MarkerState::kUnresolved ||
           state == slam::MarkerState::kElsewhere;
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

// Adds the world of b to that of a.
Result<MergeReport> mergeWorlds(slam::Map* a, const slam::Map& theirs,
                                const MergeOptions& options) {
  Result<MergeReport> report = alignMaps(*a, theirs, options);
  if (!report) return report;
  slam::Map b = theirs;
  b.moveWorld(report->T_a_b);
  const auto markers = b.markers();
  for (const auto& [id, marker] : markers) {
    if (marker.T_w_m && a->findPosed(id) == nullptr) report->added.push_back(id);
    mergeMarker(marker, report->disagreeing, a, &b);
  }
  addKeyframes(b, a);
  return report;
}

// The pieces of a, to which those of b are added.
class PieceMerger {
 public:
  PieceMerger(std::vector<slam::Map> pieces, const MergeOptions& options)
      : pieces_(std::move(pieces)), options_(options) {}

  // What has joined may make others of b agree that did not before.
  void add(std::vector<slam::Map> theirs) {
    std::size_t before = 0;
    do {
      before = theirs.size();
      std::erase_if(theirs, [&](const slam::Map& piece) { return join(piece); });
    } while (!theirs.empty() && theirs.size() != before);
    for (slam::Map& piece : theirs) keepApart(std::move(piece));
  }

  [[nodiscard]] std::vector<slam::Map>& pieces() { return pieces_; }
  [[nodiscard]] MergeReport& report() { return report_; }
  // Why the first two pieces that were tried did not agree.
  [[nodiscard]] const std::optional<Error>& refusal() const { return refusal_; }

 private:
  bool join(const slam::Map& theirs) {
    for (auto home = pieces_.begin(); home != pieces_.end(); ++home) {
      const Result<MergeReport> joint = mergeWorlds(&*home, theirs, options_);
      if (!joint) {
        if (!refusal_) refusal_ = joint.error();
        continue;
      }
      if (report_.pieces_joined++ == 0) report_.T_a_b = joint->T_a_b;
      note(*joint);
      const auto bridged = std::remove_if(home + 1, pieces_.end(), [&](const slam::Map& other) {
        return mergeWorlds(&*home, other, options_).ok();
      });
      report_.bridged += static_cast<int>(pieces_.end() - bridged);
      pieces_.erase(bridged, pieces_.end());
      return true;
    }
    return false;
  }

  void note(const MergeReport& joint) {
    const auto before = static_cast<double>(report_.agreeing.size());
    const auto more = static_cast<double>(joint.agreeing.size());
    report_.rms_m =
        std::sqrt((before * report_.rms_m * report_.rms_m + more * joint.rms_m * joint.rms_m) /
                  (before + more));
    const auto append = [](const std::vector<int>& from, std::vector<int>* to) {
      to->insert(to->end(), from.begin(), from.end());
      std::ranges::sort(*to);
    };
    append(joint.agreeing, &report_.agreeing);
    append(joint.disagreeing, &report_.disagreeing);
    append(joint.added, &report_.added);
  }

  // Under a number of its own; a marker that hangs in a piece of a hangs there.
  void keepApart(slam::Map theirs) {
    int next = 0;
    for (const slam::Map& piece : pieces_) next = std::max(next, piece.piece + 1);
    theirs.piece = next;
    const auto markers = theirs.markers();
    for (const auto& [id, marker] : markers) {
      if (!marker.T_w_m) continue;
      const bool known = std::ranges::any_of(
          pieces_, [&](const slam::Map& piece) { return piece.findPosed(id) != nullptr; });
      if (!known) {
        report_.added.push_back(id);
        continue;
      }
      slam::MapMarker elsewhere = marker;
      elsewhere.state = slam::MarkerState::kElsewhere;
      elsewhere.T_w_m.reset();
      elsewhere.other_T_w_m.reset();
      (void)theirs.putMarker(elsewhere);
    }
    std::ranges::sort(report_.added);
    ++report_.pieces_apart;
    pieces_.push_back(std::move(theirs));
  }

  std::vector<slam::Map> pieces_;
  MergeOptions options_;
  MergeReport report_;
  std::optional<Error> refusal_;
};

std::vector<slam::Map> piecesOf(const io::MapFile& file) {
  std::vector<slam::Map> pieces = file.other_pieces;
  pieces.insert(pieces.begin(), file.map);
  return pieces;
}

}  // namespace

Result<MergeReport> mergeMaps(io::MapFile* a, const io::MapFile& b, const MergeOptions& options) {
  PieceMerger merger(piecesOf(*a), options);
  const auto check = [&](const slam::Map& theirs) -> Status {
    for (const slam::Map& ours : merger.pieces()) {
      if (const Status same = checkSameMarkers(ours, theirs); !same) return same;
    }
    return success();
  };
  if (const Status same = check(b.map); !same) return same.error();
  for (const slam::Map& piece : b.other_pieces) {
    if (const Status same = check(piece); !same) return same.error();
  }
  io::MapFile seen = b;
  std::optional<std::string> warning;
  if (a->camera && seen.camera) {
    const auto changed = io::changeCamera(*a->camera, &seen);
    if (!changed) return changed.error();
    warning = *changed;
  }
  merger.add(piecesOf(seen));
  if (merger.report().pieces_joined == 0) return *merger.refusal();
  a->map = std::move(merger.pieces().front());
  a->other_pieces.assign(std::make_move_iterator(merger.pieces().begin() + 1),
                         std::make_move_iterator(merger.pieces().end()));
  if (!a->camera) a->camera = seen.camera;
  if (a->readout_s == 0.0) a->readout_s = seen.readout_s;  // one camera, one shutter
  if (a->camera && a->readout_s != 0.0) {
    io::undistortAgain(slam::CameraModel(*a->camera), a);
  }
  a->has_checksum = a->has_checksum && b.has_checksum;
  if (warning) merger.report().warnings.push_back(*warning);
  return std::move(merger.report());
}

}  // namespace waymark::tools
