// Files of natural markers: {"format":"natural-markers","version":1,"markers":[{"name","image",
// "width","height","T_w_m":{"p","q"}}]}. Other keys are ignored.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "slam/geometry/transform.h"

namespace waymark::io {

struct NaturalMarkerEntry {
  std::string name;
  std::filesystem::path image;  // as the file says it: relative to the file, or absolute
  double width_m = 0.0;
  double height_m = 0.0;                 // 0: from the image's shape
  std::optional<slam::Transform> T_w_m;  // empty: to be found by the map
};

// `file` is for messages: "FILE: markers[2].width: reason". Names are not given twice.
[[nodiscard]] Result<std::vector<NaturalMarkerEntry>> parseNaturalMarkers(
    const std::string& text, const std::filesystem::path& file);

// The text of a file with one more marker; everything else in it stays. An empty text becomes a new
// file.
[[nodiscard]] Result<std::string> withNaturalMarker(const std::string& text,
                                                    const std::filesystem::path& file,
                                                    const NaturalMarkerEntry& entry);

}  // namespace waymark::io
