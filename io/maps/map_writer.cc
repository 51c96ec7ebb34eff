#include <array>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "io/maps/map_file.h"
#include "io/maps/map_keys.h"
#include "io/text/json_node.h"

namespace waymark::io {
namespace {

std::string_view nameOf(slam::MarkerState state) {
  for (const auto& [name, value] : map_keys::kStates) {
    if (value == state) return name;
  }
  return {};
}

Json matrixJson(const Eigen::Matrix2d& symmetric) {
  return Json::array({symmetric(0, 0), symmetric(0, 1), symmetric(1, 1)});
}

template <typename T>
Json listOfFour(const std::array<T, 4>& corners) {
  Json list = Json::array();
  for (const T& corner : corners) list.push_back(toJson(corner));
  return list;
}

// The upper triangle, row by row.
template <int size>
Json covarianceJson(const Eigen::Matrix<double, size, size>& symmetric) {
  Json list = Json::array();
  for (Eigen::Index row = 0; row < size; ++row) {
    for (Eigen::Index column = row; column < size; ++column) list.push_back(symmetric(row, column));
  }
  return list;
}

Json cameraJson(const slam::Calibration& c, double readout_s) {
  const bool fisheye = c.model == slam::DistortionModel::kEquidistant;
  Json json = {{"width", c.width},
               {"height", c.height},
               {"fx", c.fx},
               {"fy", c.fy},
               {"cx", c.cx},
               {"cy", c.cy},
               {"distortion_model", fisheye ? "equidistant" : "rational_polynomial"},
               {"distortion", c.distortion},
               {"readout_s", readout_s}};
  if (c.covariance) json[map_keys::kIntrinsicsCovariance] = covarianceJson(*c.covariance);
  return json;
}

Json fieldJson(const FieldSize& field) {
  return {{"length_m", field.length_m}, {"width_m", field.width_m}};
}

Json markerJson(const slam::MapMarker& marker, const std::string& dictionary) {
  Json json = {{"dictionary", dictionary}, {"id", marker.id}, {"size", marker.size_m}};
  if (marker.T_w_m) {
    slam::MapMarker read = marker;  // its corners must be those of the pose that is read back
    read.T_w_m = asRead(*marker.T_w_m);
    json["T_w_m"] = toJson(*marker.T_w_m);
    json["corners"] = listOfFour(read.cornersInWorld());
  }
  json["state"] = nameOf(marker.state);
  if (marker.other_T_w_m) json["other_T_w_m"] = toJson(*marker.other_T_w_m);
  const bool in_world = !marker.world_covariance.isZero(0.0);
  if (in_world) json["covariance"] = covarianceJson(marker.world_covariance);
  // With the one in the world always: who reads "covariance" alone has an older file.
  if (in_world || !marker.covariance.isZero(0.0)) {
    json[map_keys::kGivenKeyframes] = covarianceJson(marker.covariance);
  }
  if (!marker.former_poses.empty()) {
    json["former_poses"] = Json::array();
    for (const slam::Transform& T : marker.former_poses) json["former_poses"].push_back(toJson(T));
  }
  return json;
}

// As markerJson(), of a natural marker.
Json pictureJson(const slam::MapMarker& marker) {
  Json json = markerJson(marker, "");
  json.erase("dictionary");
  json.erase("size");
  json["name"] = marker.picture;
  json["width"] = marker.size_m;
  json["height"] = marker.height_m;
  return json;
}

Json keyframeJson(const slam::Keyframe& keyframe) {
  Json detections = Json::array();
  for (const slam::MarkerDetection& detection : keyframe.detections) {
    Json covariances = Json::array();
    for (std::size_t k = 0; k < 4; ++k) covariances.push_back(matrixJson(detection.noise(k)));
    detections.push_back({{"id", detection.id},
                          {"hamming", detection.hamming},
                          {"pixels", listOfFour(detection.pixels)},
                          {"normalised_covariance", std::move(covariances)}});
  }
  Json json = {{"index", keyframe.id},
               {"sequence", keyframe.sequence},
               {"time_ns", keyframe.monotonic_ns},
               {"T_w_c", toJson(keyframe.T_w_c)}};
  if (!keyframe.twist.isZero(0.0)) {
    const slam::Vector6d& v = keyframe.twist;
    json["twist"] = Json::array({v[0], v[1], v[2], v[3], v[4], v[5]});
  }
  if (!keyframe.links.empty()) {
    json["links"] = Json::array();
    for (const slam::MarkerLink& link : keyframe.links) {
      json["links"].push_back({{"marker", link.marker},
                               {"T_c_m", toJson(link.T_c_m)},
                               {"covariance", covarianceJson(link.covariance)}});
    }
  }
  json["detections"] = std::move(detections);
  return json;
}

std::vector<const slam::Map*> pointersTo(std::span<const slam::Map> pieces) {
  std::vector<const slam::Map*> pointers;
  for (const slam::Map& piece : pieces) pointers.push_back(&piece);
  return pointers;
}

}  // namespace

std::string formatMap(const slam::Map& map, const std::optional<slam::Calibration>& camera,
                      double readout_s, const std::optional<FieldSize>& field,
                      std::span<const slam::Map* const> other_pieces) {
  std::vector<Json> posed;
  std::vector<Json> unposed;
  std::vector<Json> pictures;
  std::vector<Json> keyframes;
  const auto add = [&](const slam::Map& piece) {
    const auto inPiece = [&](Json json) {
      if (piece.piece != 0) json["piece"] = piece.piece;
      return json;
    };
    for (const auto& [id, marker] : piece.markers()) {
      if (slam::isPicture(id)) {
        pictures.push_back(inPiece(pictureJson(marker)));
        continue;
      }
      (marker.T_w_m ? posed : unposed).push_back(inPiece(markerJson(marker, map.dictionary)));
    }
    for (const auto& [id, keyframe] : piece.keyframes()) {
      keyframes.push_back(inPiece(keyframeJson(keyframe)));
    }
  };
  add(map);
  for (const slam::Map* const piece : other_pieces) add(*piece);

  const std::string head =
      "{" + jsonField("format", map_keys::kFormat) + jsonField("version", map_keys::kVersion);
  std::string body = jsonField("dictionary", map.dictionary);
  body += jsonField("camera", camera ? cameraJson(*camera, readout_s) : Json(nullptr));
  if (field) body += jsonField("field", fieldJson(*field));
  body += jsonList("markers", posed) + ",\n";
  body += jsonList("unposed_markers", unposed) + ",\n";
  if (!pictures.empty()) body += jsonList("natural_markers", pictures) + ",\n";
  body += jsonList("keyframes", keyframes) + "}\n";
  return head + map_keys::checksumLine(map_keys::checksum(head, body)) + body;
}

std::string formatMap(std::span<const slam::Map> pieces,
                      const std::optional<slam::Calibration>& camera, double readout_s,
                      const std::optional<FieldSize>& field) {
  const std::vector<const slam::Map*> others = pointersTo(pieces.subspan(1));
  return formatMap(pieces.front(), camera, readout_s, field, others);
}

std::string formatMap(const MapFile& file) {
  const std::vector<const slam::Map*> others = pointersTo(file.other_pieces);
  return formatMap(file.map, file.camera, file.readout_s, file.field, others);
}

}  // namespace waymark::io
