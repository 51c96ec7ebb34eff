#include "io/maps/marker_corners.h"

#include <algorithm>
#include <string>

#include "io/text/json_node.h"
#include "io/text/text_file.h"

namespace waymark::io {
namespace {

MarkerCorners markerCorners(const JsonNode& node) {
  MarkerCorners marker;
  marker.id = static_cast<int>(node.at("id").integer(0, 1'000'000));
  marker.size_m = node.at("size").positive();
  const std::vector<JsonNode> corners = node.at("corners").elements(4);
  for (std::size_t i = 0; i < corners.size(); ++i) marker.corners[i] = corners[i].point3();
  if (node.has("piece")) marker.piece = static_cast<int>(node.at("piece").integer(0, 1'000'000));
  return marker;
}

}  // namespace

Status writeMarkerLayout(const std::filesystem::path& path, std::span<const MarkerCorners> markers,
                         std::string_view note) {
  std::vector<Json> list;
  for (const MarkerCorners& marker : markers) {
    Json corners = Json::array();
    for (const Eigen::Vector3d& corner : marker.corners) corners.push_back(toJson(corner));
    list.push_back({{"id", marker.id}, {"size", marker.size_m}, {"corners", corners}});
  }
  return writeTextFile(path, "{" + jsonField("note", note) + jsonList("markers", list) + "}\n");
}

Result<std::vector<MarkerCorners>> readMarkerCorners(const std::filesystem::path& path) {
  const Result<std::string> text = readTextFile(path);
  if (!text) return text.error();
  const Result<Json> json = parseJson(*text, path.string());
  if (!json) return json.error();
  std::string fault;
  const JsonNode root(*json, &fault);
  if (root.has("version")) (void)root.at("version").integer(1, 1);
  std::vector<MarkerCorners> markers;
  for (const JsonNode& node : root.at("markers").elements()) {
    markers.push_back(markerCorners(node));
    if (!fault.empty()) break;
  }
  if (!fault.empty()) return Error{path.string() + ": " + fault};
  std::stable_sort(markers.begin(), markers.end(),
                   [](const auto& a, const auto& b) { return a.id < b.id; });
  const auto twice = std::adjacent_find(markers.begin(), markers.end(),
                                        [](const auto& a, const auto& b) { return a.id == b.id; });
  if (twice != markers.end()) {
    return Error{path.string() + ": markers: id " + std::to_string(twice->id) + " occurs twice"};
  }
  return markers;
}

std::array<Eigen::Vector3d, 4> rectangleCorners(const slam::Transform& T_w_m, double width_m,
                                                double height_m) {
  const double x = 0.5 * width_m;
  const double y = 0.5 * height_m;
  return {T_w_m * Eigen::Vector3d(-x, y, 0.0), T_w_m * Eigen::Vector3d(x, y, 0.0),
          T_w_m * Eigen::Vector3d(x, -y, 0.0), T_w_m * Eigen::Vector3d(-x, -y, 0.0)};
}

std::vector<NaturalMarkerCorners> posedNaturalMarkerCorners(const slam::Map& map) {
  std::vector<NaturalMarkerCorners> pictures;
  for (const auto& [id, marker] : map.markers()) {
    if (!marker.T_w_m || !slam::isPicture(id)) continue;
    pictures.push_back(
        {marker.picture, rectangleCorners(*marker.T_w_m, marker.size_m, marker.height_m)});
  }
  return pictures;
}

std::vector<MarkerCorners> posedMarkerCorners(const slam::Map& map) {
  std::vector<MarkerCorners> markers;
  for (const auto& [id, marker] : map.markers()) {
    if (!marker.T_w_m || slam::isPicture(id)) continue;
    markers.push_back({id, marker.size_m, marker.cornersInWorld(), map.piece});
  }
  return markers;
}

}  // namespace waymark::io
