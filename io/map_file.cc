#include "io/map_file.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <nlohmann/json.hpp>

#include "io/number_text.h"
#include "io/text_file.h"

namespace waymark::io {
namespace {

// Keeps the order of insertion, so that the text is the one written below.
using Json = nlohmann::ordered_json;

constexpr std::string_view kFormat = "waymark-map";
constexpr int kVersion = 1;

Json toJson(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }
Json toJson(const Eigen::Vector2d& v) { return Json::array({v.x(), v.y()}); }
Json toJson(const Eigen::Matrix2d& symmetric) {
  return Json::array({symmetric(0, 0), symmetric(0, 1), symmetric(1, 1)});
}
Json toJson(const slam::Transform& T) {
  const Eigen::Quaterniond q = T.quaternion();
  return {{"p", toJson(T.p)}, {"q", Json::array({q.w(), q.x(), q.y(), q.z()})}};
}

template <typename T>
Json toJson(const std::array<T, 4>& corners) {
  Json list = Json::array();
  for (const T& corner : corners) list.push_back(toJson(corner));
  return list;
}

Json toJson(const slam::Calibration& c) {
  const bool fisheye = c.model == slam::DistortionModel::kEquidistant;
  return {{"width", c.width},
          {"height", c.height},
          {"fx", c.fx},
          {"fy", c.fy},
          {"cx", c.cx},
          {"cy", c.cy},
          {"distortion_model", fisheye ? "equidistant" : "rational_polynomial"},
          {"distortion", c.distortion}};
}

Json toJson(const slam::MapMarker& marker, const std::string& dictionary) {
  Json json = {{"dictionary", dictionary}, {"id", marker.id}, {"size", marker.size_m}};
  if (marker.T_w_m) {
    json["T_w_m"] = toJson(*marker.T_w_m);
    json["corners"] = toJson(marker.cornersInWorld());
  }
  return json;
}

Json toJson(const slam::Keyframe& keyframe) {
  Json detections = Json::array();
  for (const slam::MarkerDetection& detection : keyframe.detections) {
    detections.push_back({{"id", detection.id},
                          {"hamming", detection.hamming},
                          {"pixels", toJson(detection.pixels)},
                          {"normalised_covariance", toJson(detection.covariance)}});
  }
  return {{"index", keyframe.id},
          {"sequence", keyframe.sequence},
          {"time_ns", keyframe.monotonic_ns},
          {"T_w_c", toJson(keyframe.T_w_c)},
          {"detections", std::move(detections)}};
}

// `"key":[` and one element a line: readable, and differences between two maps stay local.
std::string listText(std::string_view key, const std::vector<Json>& elements) {
  std::string text = "\"" + std::string(key) + "\":[";
  for (std::size_t i = 0; i < elements.size(); ++i) {
    text += (i == 0 ? "\n" : ",\n") + elements[i].dump();
  }
  return text + (elements.empty() ? "]" : "\n]");
}

std::string field(std::string_view key, const Json& value) {
  return "\"" + std::string(key) + "\":" + value.dump() + ",\n";
}

// The reading side: an optional, and on failure a reason that says which key.
std::optional<double> number(const Json& object, const char* key, std::string* fault) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_number() || !std::isfinite(found->get<double>())) {
    *fault = std::string("\"") + key + "\" must be a number";
    return std::nullopt;
  }
  return found->get<double>();
}

std::optional<Eigen::Vector3d> point(const Json& json) {
  if (!json.is_array() || json.size() != 3) return std::nullopt;
  Eigen::Vector3d p;
  for (std::size_t i = 0; i < 3; ++i) {
    if (!json[i].is_number()) return std::nullopt;
    p[static_cast<Eigen::Index>(i)] = json[i].get<double>();
  }
  if (!p.allFinite()) return std::nullopt;
  return p;
}

std::optional<MarkerCorners> markerCorners(const Json& json, std::string* fault) {
  MarkerCorners marker;
  const auto id = json.find("id");
  if (id == json.end() || !id->is_number_integer() || id->get<std::int64_t>() < 0 ||
      id->get<std::int64_t>() > 1'000'000) {
    *fault = "\"id\" must be a whole number from 0 on";
    return std::nullopt;
  }
  marker.id = id->get<int>();
  const std::optional<double> size = number(json, "size", fault);
  if (!size) return std::nullopt;
  if (*size <= 0.0) return *fault = "\"size\" must be positive", std::nullopt;
  marker.size_m = *size;
  *fault = "\"corners\" must be four points [x, y, z]";
  const auto corners = json.find("corners");
  if (corners == json.end() || !corners->is_array() || corners->size() != 4) return std::nullopt;
  for (std::size_t i = 0; i < 4; ++i) {
    const std::optional<Eigen::Vector3d> corner = point((*corners)[i]);
    if (!corner) return std::nullopt;
    marker.corners[i] = *corner;
  }
  return marker;
}

}  // namespace

std::string formatMap(const slam::Map& map, const slam::Calibration& camera) {
  std::vector<Json> posed;
  std::vector<Json> unposed;
  for (const auto& [id, marker] : map.markers()) {
    (marker.T_w_m ? posed : unposed).push_back(toJson(marker, map.dictionary));
  }
  std::vector<Json> keyframes;
  for (const auto& [id, keyframe] : map.keyframes()) keyframes.push_back(toJson(keyframe));

  std::string text = "{";
  text += field("format", kFormat) + field("version", kVersion);
  text += field("dictionary", map.dictionary) + field("camera", toJson(camera));
  text += listText("markers", posed) + ",\n";
  text += listText("unposed_markers", unposed) + ",\n";
  text += listText("keyframes", keyframes) + "}\n";
  return text;
}

Status writeMarkerLayout(const std::filesystem::path& path, std::span<const MarkerCorners> markers,
                         std::string_view note) {
  std::vector<Json> list;
  for (const MarkerCorners& marker : markers) {
    list.push_back(
        {{"id", marker.id}, {"size", marker.size_m}, {"corners", toJson(marker.corners)}});
  }
  return writeTextFile(path, "{" + field("note", note) + listText("markers", list) + "}\n");
}

Result<std::vector<MarkerCorners>> readMarkerCorners(const std::filesystem::path& path) {
  const Result<std::string> text = readTextFile(path);
  if (!text) return text.error();
  const std::string file = path.string();
  const Json json = Json::parse(*text, nullptr, /*allow_exceptions=*/false);
  if (json.is_discarded() || !json.is_object()) return Error{file + ": is not a JSON object"};
  if (const auto version = json.find("version"); version != json.end() && *version != kVersion) {
    return Error{file + ": \"version\" is " + version->dump() + ", this program reads 1"};
  }
  const auto list = json.find("markers");
  if (list == json.end() || !list->is_array()) {
    return Error{file + ": \"markers\" must be a list"};
  }
  std::vector<MarkerCorners> markers;
  for (std::size_t i = 0; i < list->size(); ++i) {
    std::string fault;
    const std::optional<MarkerCorners> marker = markerCorners((*list)[i], &fault);
    if (!marker) return Error{file + ": markers[" + std::to_string(i) + "]: " + fault};
    markers.push_back(*marker);
  }
  std::stable_sort(markers.begin(), markers.end(),
                   [](const auto& a, const auto& b) { return a.id < b.id; });
  const auto twice = std::adjacent_find(markers.begin(), markers.end(),
                                        [](const auto& a, const auto& b) { return a.id == b.id; });
  if (twice != markers.end()) {
    return Error{file + ": markers: id " + std::to_string(twice->id) + " occurs twice"};
  }
  return markers;
}

std::vector<MarkerCorners> posedMarkerCorners(const slam::Map& map) {
  std::vector<MarkerCorners> markers;
  for (const auto& [id, marker] : map.markers()) {
    if (marker.T_w_m) markers.push_back({id, marker.size_m, marker.cornersInWorld()});
  }
  return markers;
}

}  // namespace waymark::io
