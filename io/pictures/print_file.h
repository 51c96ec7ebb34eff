// What the SLAM is told of natural markers, as text: a recording carries it along, so that it can
// be run again without the pictures.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "base/result.h"
#include "slam/map/picture_print.h"

namespace waymark::io {

// JSON. Reading and writing it again gives the same text.
[[nodiscard]] std::string formatPrints(const std::vector<slam::PicturePrint>& prints);

// `file` is for messages: "FILE: markers[2].width: reason".
[[nodiscard]] Result<std::vector<slam::PicturePrint>> parsePrints(
    const std::string& text, const std::filesystem::path& file);

}  // namespace waymark::io
