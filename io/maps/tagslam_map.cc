#include "io/maps/tagslam_map.h"

#include <optional>

#include "io/text/number_text.h"
#include "io/text/yaml_text.h"

namespace waymark::io {
namespace {

// Small against what a camera measures: the map is taken as it is.
constexpr double kNoise_m = 0.001;
constexpr double kNoise_rad = 0.001;

std::string vectorText(const std::string& indent, const std::string& key,
                       const Eigen::Vector3d& v) {
  return indent + key + ":\n" + indent + "  x: " + roundTrip(v.x()) + "\n" + indent +
         "  y: " + roundTrip(v.y()) + "\n" + indent + "  z: " + roundTrip(v.z()) + "\n";
}

std::string poseText(const std::string& indent, const slam::Transform& T) {
  return indent + "pose:\n" + vectorText(indent + "  ", "position", T.p) +
         vectorText(indent + "  ", "rotation", slam::logSo3(T.R)) +
         vectorText(indent + "  ", "position_noise", Eigen::Vector3d::Constant(kNoise_m)) +
         vectorText(indent + "  ", "rotation_noise", Eigen::Vector3d::Constant(kNoise_rad));
}

Eigen::Vector3d readVector(const JsonNode& node) {
  return {node.at("x").number(), node.at("y").number(), node.at("z").number()};
}

// Empty when there is no pose.
std::optional<slam::Transform> readPose(const JsonNode& node) {
  if (!node.has("pose")) return std::nullopt;
  const JsonNode pose = node.at("pose");
  const Eigen::Vector3d p = readVector(pose.at("position"));
  return slam::Transform{slam::expSo3(readVector(pose.at("rotation"))), p};
}

void readBody(const JsonNode& body, PosedMarkers* result) {
  if (!body.has("is_static") || body.at("is_static").text() != "true" || !body.has("tags")) return;
  const slam::Transform T_w_b = readPose(body).value_or(slam::Transform{});
  const double default_size_m =
      body.has("default_tag_size") ? body.at("default_tag_size").number() : 0.0;
  for (const JsonNode& tag : body.at("tags").elements()) {
    const auto T_b_m = readPose(tag);
    if (!T_b_m) continue;
    PosedMarker marker;
    marker.id = static_cast<int>(tag.at("id").integer(0, 1'000'000));
    marker.size_m = tag.has("size") ? tag.at("size").positive() : default_size_m;
    marker.T_w_m = T_w_b * *T_b_m;
    result->markers.push_back(marker);
  }
}

}  // namespace

std::string formatTagslamMap(const PosedMarkers& markers) {
  std::string text = "bodies:\n  - world:\n      type: simple\n      is_static: true\n";
  const double size_m = markers.markers.empty() ? 0.0 : markers.markers.front().size_m;
  text += "      default_tag_size: " + roundTrip(size_m) + "\n";
  text += poseText("      ", slam::Transform{});
  text += "      tags:\n";
  for (const PosedMarker& marker : markers.markers) {
    text += "        - id: " + std::to_string(marker.id) + "\n";
    text += "          size: " + roundTrip(marker.size_m) + "\n";
    text += poseText("          ", marker.T_w_m);
  }
  return text;
}

Result<PosedMarkers> parseTagslamMap(const std::string& text, const std::filesystem::path& file) {
  const Result<Json> yaml = parseYaml(text, file.string());
  if (!yaml) return yaml.error();
  std::string fault;
  const JsonNode root(*yaml, &fault);
  PosedMarkers result;
  for (const JsonNode& named : root.at("bodies").elements()) {
    if (!named.json().is_object()) named.fail("must be a body");
    if (!fault.empty()) break;
    for (const auto& [name, body] : named.json().items()) {
      readBody(named.at(name.c_str()), &result);
    }
  }
  if (!fault.empty()) return Error{file.string() + ": " + fault};
  return result;
}

}  // namespace waymark::io
