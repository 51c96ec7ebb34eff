#include "slam/pieces/joint_trial.h"

#include <cmath>
#include <utility>

namespace waymark::slam {

JointTrial::Verdict JointTrial::watch(std::span<const MarkerDetection> detections,
                                      std::int64_t time_ns, const JointParts& parts) {
  const PieceOptions::Trial& options = parts.options.trial;
  if (last_ns_ > 0 && time_ns - last_ns_ < std::llround(1e9 * options.interval_s)) {
    return Verdict::kOpen;
  }
  const auto seen = [&](const Map& map) {
    std::vector<int> ids;
    for (const MarkerDetection& detection : detections) {
      if (map.findPosed(detection.id) != nullptr) ids.push_back(detection.id);
    }
    return ids;
  };
  const std::vector<int> in_into = seen(into_);
  const std::vector<int> in_from = seen(from_);
  if (in_into.empty() || in_from.empty()) return Verdict::kOpen;
  auto view = viewJoint(into_, from_, detections, parts);
  if (!view) return Verdict::kOpen;
  last_ns_ = time_ns;
  if (contradicts(*view, joint_.T_a_b, parts.options)) {
    against_.push_back(std::move(*view));
    ++frames_;
  } else {
    seen_into_.insert(in_into.begin(), in_into.end());
    seen_from_.insert(in_from.begin(), in_from.end());
    // As often as it is seen, one marker says the same.
    if (seen_into_.size() > 1 && seen_from_.size() > 1) ++frames_;
  }
  const auto against = static_cast<int>(against_.size());
  if (against >= options.against && against > (1.0 - parts.options.min_share) * frames_) {
    return Verdict::kRefuted;
  }
  return frames_ - against >= options.frames ? Verdict::kBelieved : Verdict::kOpen;
}

}  // namespace waymark::slam
