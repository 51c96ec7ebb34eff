// Of VisualFilter: which features are believed yet. What moves looks like the room when it begins
// to, and in a frame of which hardly anything is seen, what looks like a feature may be anything.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>

#include "slam/natural/filter/visual_filter.h"

namespace waymark::slam {

int VisualFilter::trialFrames() const {
  const FeatureManagementOptions& options = options_.features;
  if (!(wary_s_ > 0.0) || !(frame_s_ > 0.0)) return options.trial_frames;
  constexpr int kMost = 1000;
  return std::max(options.trial_frames,
                  static_cast<int>(std::min<double>(kMost, options.wary_trial_s / frame_s_)));
}

void VisualFilter::endTrialsOfOldest() {
  const auto enough = static_cast<std::size_t>(options_.features.believed_without_trial);
  const auto on_trial = [](const FeatureMatch& match) { return match.on_trial; };
  const auto sure =
      matches_.size() - static_cast<std::size_t>(std::ranges::count_if(matches_, on_trial));
  if (sure >= enough) return;
  ages_.clear();
  for (const FeatureMatch& match : matches_) ages_.push_back(match.age);
  std::ranges::sort(ages_, std::greater());
  // Those of the same age belong together.
  const int oldest = ages_.size() < enough ? 0 : ages_[enough - 1];
  for (FeatureMatch& match : matches_) match.on_trial = match.on_trial && match.age < oldest;
}

int VisualFilter::leastConsensus() const {
  if (!was_blind_) return 0;
  return static_cast<int>(
      std::ceil(options_.features.blind_share * static_cast<double>(candidates_.size())));
}

void VisualFilter::noteRefusals() {
  // Depths have yet to settle.
  if (running_s_ < options_.features.wary_trial_s) return;
  // Then it is known, and will be dropped.
  constexpr int kFirstTimes = 3;
  const auto is_refusal = [&](const Candidate& candidate) {
    return candidate.found && !candidate.believed && !candidate.on_trial &&
           features_[static_cast<std::size_t>(candidate.feature)].failures < kFirstTimes;
  };
  const auto refusals = std::ranges::count_if(candidates_, is_refusal);
  if (refusals >= options_.features.wary_after_refusals) wary_s_ = options_.features.wary_s;
}

}  // namespace waymark::slam
