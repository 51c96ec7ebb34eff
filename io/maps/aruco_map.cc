#include "io/maps/aruco_map.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

#include "io/text/number_text.h"
#include "io/text/yaml_text.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/detection/marker_detection.h"

namespace waymark::io {
namespace {

// Ours, ArUco's. Names that are not here are the same in both.
constexpr std::array<std::pair<std::string_view, std::string_view>, 4> kNames = {{
    {"ARUCO_ORIGINAL", "ARUCO"},
    {"APRILTAG_36h11", "TAG36h11"},
    {"APRILTAG_25h9", "TAG25h9"},
    {"APRILTAG_16h5", "TAG16h5"},
}};

std::string arucoName(const std::string& ours) {
  for (const auto& [our, aruco] : kNames) {
    if (our == ours) return std::string(aruco);
  }
  return ours;
}

// Empty when we do not have it.
std::string ourName(const std::string& theirs) {
  for (const auto& [our, aruco] : kNames) {
    if (aruco == theirs) return std::string(our);
  }
  const std::vector<std::string> all = slam::Dictionary::names();
  return std::ranges::find(all, theirs) != all.end() ? theirs : "";
}

constexpr int kMetres = 1;  // aruco_bc_mInfoType

}  // namespace

std::string formatArucoMap(const PosedMarkers& markers) {
  std::string text = "%YAML:1.0\n---\n";
  text += "aruco_bc_dict: \"" + arucoName(markers.dictionary) + "\"\n";
  text += "aruco_bc_nmarkers: " + std::to_string(markers.markers.size()) + "\n";
  text += "aruco_bc_mInfoType: " + std::to_string(kMetres) + "\n";
  text += "aruco_bc_markers:\n";
  for (const PosedMarker& marker : markers.markers) {
    text += "   - { id:" + std::to_string(marker.id) + ", corners:[";
    const char* separator = " ";
    for (const Eigen::Vector3d& corner : slam::markerCorners(marker.size_m)) {
      const Eigen::Vector3d p = marker.T_w_m * corner;
      text += separator;
      text += "[ " + roundTrip(p.x()) + ", " + roundTrip(p.y()) + ", " + roundTrip(p.z()) + " ]";
      separator = ",\n       ";
    }
    text += " ] }\n";
  }
  return text;
}

Result<PosedMarkers> parseArucoMap(const std::string& text, const std::filesystem::path& file) {
  const Result<Json> yaml = parseYaml(text, file.string());
  if (!yaml) return yaml.error();
  std::string fault;
  const JsonNode root(*yaml, &fault);
  PosedMarkers result;
  if (root.has("aruco_bc_dict")) result.dictionary = ourName(root.at("aruco_bc_dict").text());
  if (root.at("aruco_bc_mInfoType").integer(0, kMetres) != kMetres) {
    root.at("aruco_bc_mInfoType").fail("is 0, pixels; only maps in metres (1) can be read");
  }
  const std::size_t count = root.at("aruco_bc_nmarkers").natural();
  for (const JsonNode& node : root.at("aruco_bc_markers").elements(count)) {
    const int id = static_cast<int>(node.at("id").integer(0, 1'000'000));
    const std::vector<JsonNode> points = node.at("corners").elements(4);
    std::array<Eigen::Vector3d, 4> corners;
    for (std::size_t k = 0; k < points.size(); ++k) corners[k] = points[k].point3();
    if (!fault.empty()) break;
    const Result<PosedMarker> marker = markerAtCorners(id, corners);
    if (marker) result.markers.push_back(*marker);
    if (!marker) node.at("corners").fail(marker.error().message);
  }
  if (!fault.empty()) return Error{file.string() + ": " + fault};
  return result;
}

}  // namespace waymark::io
