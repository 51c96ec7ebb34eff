// Marker ids and sizes as people write them: "3, 7-9" and "10-19=0.2, 42=0.05".
#pragma once

#include <string_view>
#include <vector>

#include "base/result.h"
#include "slam/map/marker_options.h"

namespace waymark::io {

// The error says what is wrong with which part.
[[nodiscard]] Result<std::vector<slam::IdRange>> parseIdRanges(std::string_view text);
// Sizes in metres.
[[nodiscard]] Result<std::vector<slam::MarkerOptions::Size>> parseMarkerSizes(
    std::string_view text);

}  // namespace waymark::io
