#include "slam/initialization/initializer.h"

#include <algorithm>
#include <iterator>
#include <utility>
#include <variant>

#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

NoPoseReason reasonOf(TwoFrameFailure failure) {
  switch (failure) {
    case TwoFrameFailure::kNoCommonMarker:
      return NoPoseReason::kNoneShared;
    case TwoFrameFailure::kShortBaseline:
      return NoPoseReason::kShortBaseline;
    case TwoFrameFailure::kAmbiguous:
      return NoPoseReason::kAmbiguousFromTwoViews;
    case TwoFrameFailure::kPoorFit:
      return NoPoseReason::kViewsContradict;
  }
  return NoPoseReason::kNone;
}

}  // namespace

std::string InitializationOptions::invalidReason() const {
  return firstReason({
      firstUnmet({
          {ambiguity_ratio >= 1.0, "ambiguity ratios must be at least 1"},
          {isShare(min_likeness), "the likeness of a marker that starts a map must be from 0 to 1"},
          {attempts >= 1, "initialization needs at least 1 attempt"},
      }),
      two_frame.invalidReason(),
      square.invalidReason(),
  });
}

std::optional<Start> Initializer::process(const Keyframe& frame) {
  if (frame.detections.empty()) {
    reason_ = NoPoseReason::kNoMarker;
    return std::nullopt;
  }
  std::vector<MarkerDetection> sure;
  std::ranges::copy_if(frame.detections, std::back_inserter(sure), [this](const auto& detection) {
    return detection.likeness >= options_.min_likeness;
  });
  std::vector<InitialMarker> markers =
      initializeFromOneFrame(sure, markers_, focal_px_, options_.ambiguity_ratio, options_.square);
  if (!markers.empty()) {
    Start start{{frame}, std::move(markers)};
    start.keyframes[0].T_w_c = Transform{};
    return start;
  }
  return fromTwoFrames(frame);
}

std::optional<Start> Initializer::fromTwoFrames(const Keyframe& frame) {
  if (!first_ || attempts_ >= options_.attempts) {
    first_ = frame;
    attempts_ = 0;
    reason_ = NoPoseReason::kShortBaseline;
    return std::nullopt;
  }
  ++attempts_;
  auto outcome = initializeFromTwoFrames(first_->detections, frame.detections, markers_, focal_px_,
                                         options_.two_frame);
  if (const auto* failure = std::get_if<TwoFrameFailure>(&outcome)) {
    reason_ = reasonOf(*failure);
    return std::nullopt;
  }
  const auto& found = std::get<TwoFrameStart>(outcome);
  Start start{{*first_, frame}, found.markers};
  start.keyframes[0].T_w_c = Transform{};
  start.keyframes[1].T_w_c = found.T_0_1;
  return start;
}

}  // namespace waymark::slam
