// Maps of other programs: ArUco, TagSLAM, WPILib. What can be imported makes a map file that reads
// back.
#include "io/maps/aruco_map.h"
#include "io/maps/map_file.h"
#include "io/maps/tagslam_map.h"
#include "io/maps/wpilib_map.h"
#include "tests/fuzz/fuzz_target.h"

using namespace waymark;

namespace {

// As waymark map import does it.
void takeOver(Result<io::PosedMarkers> markers) {
  if (!markers) return fuzz::requireOneLine(markers.error());
  if (markers->dictionary.empty()) markers->dictionary = "APRILTAG_36h11";
  for (io::PosedMarker& marker : markers->markers) {
    if (marker.size_m == 0.0) marker.size_m = 0.16;
  }
  const Result<slam::Map> map = io::mapOf(*markers, "import");
  if (!map) return fuzz::requireOneLine(map.error());
  const std::string text = io::formatMap(*map, std::nullopt);
  const auto again = io::parseMap(text, "map.json");
  fuzz::require(again.ok(), "what was imported is read: " +
                                (again ? std::string() : again.error().message) + "\n" + text);
  fuzz::require(io::formatMap(again->map, again->camera) == text, "and keeps its bytes:\n" + text);
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text = fuzz::textOf(data, size);
  takeOver(io::parseArucoMap(text, "aruco.yml"));
  takeOver(io::parseTagslamMap(text, "tagslam.yaml"));
  takeOver(io::parseWpilibMap(text, "wpilib.json"));
  return 0;
}
