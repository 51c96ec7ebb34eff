// Which markers a camera could see in each frame: part of a simulation's truth (gt_visible.csv).
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"

namespace waymark::io {

struct VisibleMarker {
  std::int64_t time_ns = 0;  // of the frame
  int id = -1;
  double side_px = 0.0;  // the shortest side in the image
};

// Lines "t,id,side_px", one for every marker that is wholly in view in a frame with light; '#'
// begins a comment.
[[nodiscard]] std::string formatVisibleMarkers(std::span<const VisibleMarker> visible);

// In the order of the file. The error names the file and the line.
[[nodiscard]] Result<std::vector<VisibleMarker>> readVisibleMarkers(
    const std::filesystem::path& path);

}  // namespace waymark::io
