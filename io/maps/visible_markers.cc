#include "io/maps/visible_markers.h"

#include <string_view>

#include "base/decimal_seconds.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"

namespace waymark::io {

std::string formatVisibleMarkers(std::span<const VisibleMarker> visible) {
  std::string text = "# t,id,side_px: markers wholly in view, by frame; a dark frame has none\n";
  for (const VisibleMarker& marker : visible) {
    text += formatSeconds(marker.time_ns) + "," + std::to_string(marker.id) + "," +
            fixed(marker.side_px, 2) + "\n";
  }
  return text;
}

Result<std::vector<VisibleMarker>> readVisibleMarkers(const std::filesystem::path& path) {
  const Result<std::string> text = readTextFile(path);
  if (!text) return text.error();
  std::vector<VisibleMarker> visible;
  int number = 0;
  for (const std::string_view raw : split(*text, '\n')) {
    ++number;
    const std::string_view line = trim(raw.substr(0, raw.find('#')));
    if (line.empty()) continue;
    const std::vector<std::string_view> fields = split(line, ',');
    const auto fault = [&](const std::string& what) {
      return Error{path.string() + ":" + std::to_string(number) + ": " + what};
    };
    if (fields.size() != 3) {
      return fault("has " + std::to_string(fields.size()) + " fields, must be 3: t,id,side_px");
    }
    const auto time_ns = parseSeconds(fields[0]);
    const auto id = parseInteger(fields[1]);
    const auto side_px = parseDouble(fields[2]);
    if (!time_ns || !id || !side_px || *id < 0 || *side_px < 0.0) {
      return fault("must be a time in seconds, an id and a number of pixels");
    }
    visible.push_back({*time_ns, *id, *side_px});
  }
  return visible;
}

}  // namespace waymark::io
