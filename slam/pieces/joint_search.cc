#include "slam/pieces/joint_search.h"

#include <algorithm>
#include <set>

#include "slam/camera_pose/known_marker.h"

namespace waymark::slam {
namespace {

// Units for both poses that a marker proposes, and for each marker they are compared with.
constexpr double kProposal = 30.0;
constexpr double kCompared = 8.0;

using Frames = std::set<std::pair<int, KeyframeId>>;

// The keyframes of `a` that see what only `b` knows.
void addFrames(const Map& a, const Map& b, Frames* frames) {
  for (const auto& [id, marker] : a.markers()) {
    if (marker.T_w_m || b.findPosed(id) == nullptr) continue;
    for (const KeyframeId keyframe : a.viewsOf(id)) frames->insert({a.piece, keyframe});
  }
}

double costOf(std::span<const KnownMarker> known) {
  const auto proposing = static_cast<double>(std::min(known.size(), kProposing));
  return proposing * (kProposal + kCompared * static_cast<double>(known.size()));
}

}  // namespace

JointSearch::JointSearch(const Map& a, const Map& b, const PieceOptions& options) {
  Frames frames;
  addFrames(a, b, &frames);
  addFrames(b, a, &frames);
  const std::vector<std::pair<int, KeyframeId>> all(frames.begin(), frames.end());
  const std::size_t count = std::min(all.size(), static_cast<std::size_t>(options.max_views));
  for (std::size_t k = 0; k < count; ++k) frames_.push_back(all[k * all.size() / count]);
}

bool JointSearch::advance(const Map& a, const Map& b, const JointParts& parts, double work) {
  for (double spent = 0.0; next_ < frames_.size() && spent < work; ++next_) {
    const auto& [piece, id] = frames_[next_];
    const Map& map = piece == a.piece ? a : b;
    const auto keyframe = map.keyframes().find(id);
    if (keyframe == map.keyframes().end()) continue;  // culled meanwhile
    const std::vector<MarkerDetection> seen(keyframe->second.detections.begin(),
                                            keyframe->second.detections.end());
    spent += costOf(knownMarkers(a, seen)) + costOf(knownMarkers(b, seen));
    auto view = viewJoint(a, b, map, keyframe->second, parts);
    if (view) views_.push_back(std::move(*view));
  }
  return next_ == frames_.size();
}

}  // namespace waymark::slam
