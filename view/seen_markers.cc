#include "view/seen_markers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>
#include <utility>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"

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

slam::Transform transformOf(const double (&q)[4], const double (&p)[3]) {
  return slam::Transform::fromQuaternion(Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized(),
                                         {p[0], p[1], p[2]});
}

// Null where the camera does not see all of them.
Json projected(std::span<const Eigen::Vector3d, 4> corners_m, const slam::Transform& T_c_m,
               const slam::CameraModel& camera) {
  Json corners = Json::array();
  for (const Eigen::Vector3d& corner_m : corners_m) {
    const std::optional<Eigen::Vector2d> pixel = camera.project(T_c_m * corner_m);
    if (!pixel || !pixel->allFinite()) return nullptr;
    corners.push_back({pixel->x(), pixel->y()});
  }
  return corners;
}

// In the order of a square's.
std::array<Eigen::Vector3d, 4> pictureCorners(const natural_marker_t& marker) {
  const double x = 0.5 * marker.width;
  const double y = 0.5 * pictureHeight(marker);
  return {{{-x, y, 0.0}, {x, y, 0.0}, {x, -y, 0.0}, {-x, -y, 0.0}}};
}

// Of what hangs somewhere, and could be hidden: whether it is before the camera, its face to it.
bool inView(const slam::Transform& T_c_m, const slam::CameraModel& camera) {
  if (T_c_m.inverse().p.z() <= 0.0) return false;
  const std::optional<Eigen::Vector2d> middle = camera.project(T_c_m.p);
  return middle && middle->x() >= 0.0 && middle->y() >= 0.0 &&
         middle->x() < camera.calibration().width && middle->y() < camera.calibration().height;
}

Json seenPicture(const natural_marker_t& marker, const slam::CameraModel& camera,
                 const std::optional<slam::Transform>& T_c_w, const FoundPicture* in_frame) {
  Json seen = {{"id", marker.id}, {"name", marker.name}};
  const std::array<Eigen::Vector3d, 4> corners_m = pictureCorners(marker);
  const auto tell = [&](const char* what, const slam::Transform& T_c_m) {
    Json corners = projected(corners_m, T_c_m, camera);
    if (!corners.is_null()) seen[what] = std::move(corners);
  };
  if (in_frame != nullptr) {
    tell("corners", transformOf(in_frame->detection.q_m_c, in_frame->detection.p_m_c).inverse());
  }
  if (T_c_w) {
    const slam::Transform T_c_m = *T_c_w * transformOf(marker.q_w_m, marker.p_w_m);
    if (inView(T_c_m, camera)) tell("expected", T_c_m);
  }
  return seen;
}

bool isOfFrame(const pose_t* pose, const detections_t& frame) {
  return pose != nullptr && pose->sequence == frame.sequence && pose->source != pose_t::SOURCE_NONE;
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
  const std::optional<slam::CameraModel> camera =
      isOfFrame(pose, detections) ? modelOf(lens) : std::nullopt;
  Json markers = Json::array();
  for (const detection_t& m : detections.detections) {
    Json seen = {{"id", m.id}, {"hamming", m.hamming}, {"corners", m.corners_px}};
    const marker_t* const known = camera ? findMarker(map, m.id, pose->map_piece) : nullptr;
    if (known != nullptr) {
      const slam::Transform T_c_m =
          transformOf(pose->q_w_c, pose->p_w_c).inverse() * transformOf(known->q_w_m, known->p_w_m);
      Json expected = projected(slam::markerCorners(known->size), T_c_m, *camera);
      if (!expected.is_null()) seen["expected"] = std::move(expected);
    }
    markers.push_back(std::move(seen));
  }
  return markers;
}

Json seenPictures(const detections_t& frame, const pose_t* pose, const lens_t* lens,
                  const std::map<std::int32_t, natural_map_t>& map, const FoundPictures& found) {
  constexpr std::int64_t kLately_ns = 1'000'000'000;
  Json pictures = Json::array();
  const std::optional<slam::CameraModel> camera = modelOf(lens);
  if (!camera) return pictures;
  std::optional<slam::Transform> T_c_w;
  if (isOfFrame(pose, frame)) T_c_w = transformOf(pose->q_w_c, pose->p_w_c).inverse();
  for (const auto& [number, part] : map) {
    for (const natural_marker_t& marker : part.markers) {
      const auto last = found.find(marker.id);
      const FoundPicture* const known = last == found.end() ? nullptr : &last->second;
      const bool in_frame = known != nullptr && known->detection.sequence == frame.sequence;
      const bool same_world = T_c_w && marker.map_piece == pose->map_piece;
      Json seen = seenPicture(marker, *camera, same_world ? T_c_w : std::nullopt,
                              in_frame ? known : nullptr);
      if (!seen.contains("corners") && !seen.contains("expected")) continue;
      seen["lately"] = in_frame || (known != nullptr && known->monotonic_ns <= frame.monotonic_ns &&
                                    frame.monotonic_ns - known->monotonic_ns < kLately_ns);
      pictures.push_back(std::move(seen));
    }
  }
  return pictures;
}

double pictureHeight(const natural_marker_t& marker) {
  return marker.height > 0.0 ? marker.height : marker.width;
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
