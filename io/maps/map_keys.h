// What the writer and the reader of map.json (map_file.h) must say alike.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <utility>

#include "slam/map/map.h"

namespace waymark::io::map_keys {

inline constexpr std::string_view kFormat = "waymark-map";
inline constexpr int kVersion = 1;
inline constexpr const char* kIntrinsicsCovariance = "intrinsics_covariance";
inline constexpr const char* kGivenKeyframes = "covariance_given_keyframes";
inline constexpr std::array<std::pair<std::string_view, slam::MarkerState>, 5> kStates = {{
    {"unresolved", slam::MarkerState::kUnresolved},
    {"mapped", slam::MarkerState::kMapped},
    {"quarantined", slam::MarkerState::kQuarantined},
    {"refused", slam::MarkerState::kBanned},
    {"elsewhere", slam::MarkerState::kElsewhere},
}};

// Over all of the text but the line of the checksum itself.
[[nodiscard]] std::string checksum(std::string_view before, std::string_view after);
[[nodiscard]] std::string checksumLine(const std::string& value);

}  // namespace waymark::io::map_keys
