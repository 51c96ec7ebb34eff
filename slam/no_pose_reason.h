// Why a frame has no pose.
#pragma once

namespace waymark::slam {

enum class NoPoseReason {
  kNone,                   // it has one
  kNoMap,                  // and none may be begun
  kLensUnknown,            // and the squares so far do not tell
  kNoMarker,               // in view
  kNoneShared,             // two-frame start: no marker is in both frames
  kShortBaseline,          // two-frame start: too near each other
  kAmbiguousFromTwoViews,  // two-frame start: also with a baseline
  kViewsContradict,        // two-frame start: no relative pose explains both views
  kNoKnownMarker,          // what is in view has no pose in the map yet
  kAmbiguousMarker,        // the only known one in view
  kMarkersDoNotFit,        // the known ones in view contradict the map or each other
  kCarriedTooUncertain,    // between markers: what was carried is beyond its limit
};

// For people; static text, empty for kNone.
[[nodiscard]] constexpr const char* describe(NoPoseReason reason) {
  switch (reason) {
    case NoPoseReason::kNone:
      return "";
    case NoPoseReason::kNoMap:
      return "there is no map, and mapping is off";
    case NoPoseReason::kLensUnknown:
      return "the lens is not known yet: come nearer to a marker, tilt the camera";
    case NoPoseReason::kNoMarker:
      return "no marker in view";
    case NoPoseReason::kNoneShared:
      return "all markers in view are ambiguous, and none is shared with an earlier frame";
    case NoPoseReason::kShortBaseline:
      return "all markers in view are ambiguous; move the camera sideways or closer";
    case NoPoseReason::kAmbiguousFromTwoViews:
      return "all markers in view are ambiguous, also from two places; move farther";
    case NoPoseReason::kViewsContradict:
      return "two views of the markers contradict each other: check sizes and calibration";
    case NoPoseReason::kNoKnownMarker:
      return "no marker in view has a pose yet";
    case NoPoseReason::kAmbiguousMarker:
      return "the only known marker in view is ambiguous";
    case NoPoseReason::kMarkersDoNotFit:
      return "the markers in view do not fit the map";
    case NoPoseReason::kCarriedTooUncertain:
      return "the carried pose is less certain than its limit";
  }
  return "";
}

}  // namespace waymark::slam
