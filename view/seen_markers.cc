#include "view/seen_markers.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"

namespace waymark::view {
namespace {

using io::Json;

std::optional<slam::CameraModel> modelOf(const lens_t* lens) {
  const auto calibration = lens == nullptr ? std::nullopt : calibrationOf(*lens);
  return calibration ? std::optional<slam::CameraModel>(*calibration) : std::nullopt;
}

const marker_t* findMarker(const std::map<std::int32_t, map_t>& map, std::int32_t id,
                           std::int32_t piece) {
  for (const auto& [number, part] : map) {
    for (const marker_t& marker : part.markers) {
      if (marker.id == id && marker.map_piece == piece) return &marker;
    }
  }
  return nullptr;
}

Eigen::Quaterniond orientation(const double (&q)[4]) {
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized();
}

Json expectedCorners(const marker_t& marker, const pose_t& pose, const slam::CameraModel& camera) {
  const Eigen::Vector3d p_w_m(marker.p_w_m[0], marker.p_w_m[1], marker.p_w_m[2]);
  const Eigen::Vector3d p_w_c(pose.p_w_c[0], pose.p_w_c[1], pose.p_w_c[2]);
  const Eigen::Quaterniond q_w_m = orientation(marker.q_w_m);
  const Eigen::Quaterniond q_c_w = orientation(pose.q_w_c).conjugate();
  Json corners = Json::array();
  for (const Eigen::Vector3d& corner_m : slam::markerCorners(marker.size)) {
    const Eigen::Vector3d p_w = q_w_m * corner_m + p_w_m;
    const std::optional<Eigen::Vector2d> pixel = camera.project(q_c_w * (p_w - p_w_c));
    if (!pixel || !pixel->allFinite()) return nullptr;
    corners.push_back({pixel->x(), pixel->y()});
  }
  return corners;
}

}  // namespace

std::optional<slam::Calibration> calibrationOf(const lens_t& lens) {
  slam::Calibration c;
  c.width = lens.width;
  c.height = lens.height;
  c.fx = lens.fx;
  c.fy = lens.fy;
  c.cx = lens.cx;
  c.cy = lens.cy;
  if (lens.model == lens_t::MODEL_EQUIDISTANT) c.model = slam::DistortionModel::kEquidistant;
  std::copy_n(lens.distortion, c.distortion.size(), c.distortion.begin());
  if (!c.invalidReason().empty()) return std::nullopt;
  return c;
}

Json seenMarkers(const detections_t& detections, const pose_t* pose, const lens_t* lens,
                 const std::map<std::int32_t, map_t>& map) {
  const bool has_pose = pose != nullptr && pose->sequence == detections.sequence &&
                        pose->source != pose_t::SOURCE_NONE;
  const std::optional<slam::CameraModel> camera = has_pose ? modelOf(lens) : std::nullopt;
  Json markers = Json::array();
  for (const detection_t& m : detections.detections) {
    Json seen = {{"id", m.id}, {"hamming", m.hamming}, {"corners", m.corners_px}};
    const marker_t* const known = camera ? findMarker(map, m.id, pose->map_piece) : nullptr;
    if (known != nullptr) {
      Json expected = expectedCorners(*known, *pose, *camera);
      if (!expected.is_null()) seen["expected"] = std::move(expected);
    }
    markers.push_back(std::move(seen));
  }
  return markers;
}

bool isPlausible(const preview_t& preview) {
  constexpr std::int32_t kMostPixels = 1 << 14;
  constexpr std::size_t kMostBytes = 1 << 22;
  constexpr std::size_t kMostSquares = 1000;
  const auto& jpeg = preview.jpeg;
  return preview.width > 0 && preview.height > 0 && preview.width <= kMostPixels &&
         preview.height <= kMostPixels && preview.rejected_px.size() <= kMostSquares &&
         jpeg.size() > 2 && jpeg.size() <= kMostBytes && jpeg[0] == 0xff && jpeg[1] == 0xd8;
}

Json previewJson(const preview_t& preview) {
  return {{"type", "preview"},
          {"sequence", preview.sequence},
          {"width", preview.width},
          {"height", preview.height},
          {"rejected", preview.rejected_px},
          {"image", "data:image/jpeg;base64," + base64(preview.jpeg)}};
}

bool isPlausible(const calibration_t& calibration) {
  constexpr std::int32_t kMostCells = 1000;
  constexpr std::size_t kMostPoints = 10'000;
  const std::int64_t cells = std::int64_t{calibration.columns} * calibration.rows;
  return calibration.columns > 0 && calibration.rows > 0 && cells <= kMostCells &&
         std::cmp_equal(calibration.points_in_cell.size(), cells) &&
         calibration.points_px.size() <= kMostPoints;
}

Json boardJson(const calibration_t& calibration) {
  return {{"points", calibration.points_px},
          {"columns", calibration.columns},
          {"rows", calibration.rows},
          {"cells", calibration.points_in_cell}};
}

double coveredShare(const calibration_t& calibration) {
  const auto covered =
      std::ranges::count_if(calibration.points_in_cell, [](std::int32_t n) { return n > 0; });
  return static_cast<double>(covered) / static_cast<double>(calibration.points_in_cell.size());
}

std::string base64(std::span<const std::uint8_t> bytes) {
  static constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t here = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t bits = 0;
    for (std::size_t k = 0; k < 3; ++k) bits = bits << 8U | (k < here ? bytes[i + k] : 0U);
    for (std::size_t k = 0; k < 4; ++k) {
      text += k <= here ? kDigits[bits >> (18U - 6U * k) & 63U] : '=';
    }
  }
  return text;
}

}  // namespace waymark::view
