#include "io/maps/wpilib_map.h"

#include <algorithm>

#include "io/text/json_node.h"

namespace waymark::io {
namespace {

// From our marker's frame (x right, y up, z out) to WPILib's tag (x out, y right, z up).
slam::Transform T_tag_m() {
  slam::Transform T;
  T.R << 0.0, 0.0, 1.0,  //
      1.0, 0.0, 0.0,     //
      0.0, 1.0, 0.0;
  return T;
}

Json tagJson(const PosedMarker& marker) {
  const slam::Transform T_w_tag = marker.T_w_m * T_tag_m().inverse();
  const Eigen::Quaterniond q = T_w_tag.quaternion();
  const Eigen::Vector3d& p = T_w_tag.p;
  const Json translation = {{"x", p.x()}, {"y", p.y()}, {"z", p.z()}};
  const Json quaternion = {{"W", q.w()}, {"X", q.x()}, {"Y", q.y()}, {"Z", q.z()}};
  return {{"ID", marker.id},
          {"pose", {{"translation", translation}, {"rotation", {{"quaternion", quaternion}}}}}};
}

PosedMarker readTag(const JsonNode& tag) {
  PosedMarker marker;
  marker.id = static_cast<int>(tag.at("ID").integer(0, 1'000'000));
  const JsonNode translation = tag.at("pose").at("translation");
  const Eigen::Vector3d p(translation.at("x").number(), translation.at("y").number(),
                          translation.at("z").number());
  const JsonNode quaternion = tag.at("pose").at("rotation").at("quaternion");
  const Eigen::Quaterniond q(quaternion.at("W").number(), quaternion.at("X").number(),
                             quaternion.at("Y").number(), quaternion.at("Z").number());
  if (tag.good() && !(q.norm() > 1e-6)) quaternion.fail("must not be zero");  // WPILib normalizes
  if (tag.good()) marker.T_w_m = slam::Transform::fromQuaternion(q, p) * T_tag_m();
  return marker;
}

// What is written of a map without a field may be 0; that says nothing.
std::optional<FieldSize> readLayoutField(const JsonNode& node) {
  const FieldSize field{node.at("length").number(), node.at("width").number()};
  if (!(field.length_m > 0.0 && field.width_m > 0.0)) return std::nullopt;
  return field;
}

}  // namespace

std::string formatWpilibMap(const PosedMarkers& markers) {
  std::vector<Json> tags;
  FieldSize extent;
  for (const PosedMarker& marker : markers.markers) {
    tags.push_back(tagJson(marker));
    extent.length_m = std::max(extent.length_m, marker.T_w_m.p.x());
    extent.width_m = std::max(extent.width_m, marker.T_w_m.p.y());
  }
  const FieldSize size = markers.field.value_or(extent);
  const Json field = {{"length", size.length_m}, {"width", size.width_m}};
  return "{" + jsonList("tags", tags) + ",\n\"field\":" + field.dump() + "}\n";
}

Result<PosedMarkers> parseWpilibMap(const std::string& text, const std::filesystem::path& file) {
  const Result<Json> json = parseJson(text, file.string());
  if (!json) return json.error();
  std::string fault;
  const JsonNode root(*json, &fault);
  PosedMarkers result;
  if (root.has("field")) result.field = readLayoutField(root.at("field"));
  for (const JsonNode& tag : root.at("tags").elements()) {
    result.markers.push_back(readTag(tag));
    if (!fault.empty()) return Error{file.string() + ": " + fault};
  }
  if (!fault.empty()) return Error{file.string() + ": " + fault};
  return result;
}

}  // namespace waymark::io
