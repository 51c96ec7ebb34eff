#include "tools/maps/map_info.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <Eigen/Geometry>

#include "base/image_view.h"
#include "io/text/number_text.h"

namespace waymark::tools {
namespace {

struct SquareSum {
  std::size_t corners = 0;
  double px2 = 0.0;

  [[nodiscard]] ReprojectionFit fit() const {
    if (corners == 0) return {};
    return {corners, std::sqrt(px2 / static_cast<double>(corners))};
  }
};

std::map<int, SquareSum> squareSums(const io::MapFile& file) {
  std::map<int, SquareSum> sums;
  if (!file.camera) return sums;
  const slam::CameraModel camera(*file.camera);
  for (const auto& [id, keyframe] : file.map.keyframes()) {
    const slam::Transform T_c_w = keyframe.T_w_c.inverse();
    for (const slam::MarkerDetection& detection : keyframe.detections) {
      const slam::MapMarker* marker = file.map.findPosed(detection.id);
      if (marker == nullptr) continue;
      const auto corners = marker->cornersInWorld();
      for (std::size_t k = 0; k < 4; ++k) {
        const auto pixel = camera.project(T_c_w * corners[k]);
        if (!pixel) continue;
        SquareSum& sum = sums[detection.id];
        ++sum.corners;
        sum.px2 += (*pixel - detection.pixels[k]).squaredNorm();
      }
    }
  }
  return sums;
}

const char* stateText(slam::MarkerState state) {
  switch (state) {
    case slam::MarkerState::kMapped:
      return "mapped";
    case slam::MarkerState::kQuarantined:
      return "quarantined";
    case slam::MarkerState::kBanned:
      return "refused";
    case slam::MarkerState::kElsewhere:
    case slam::MarkerState::kUnresolved:
      break;
  }
  return "unresolved";
}

std::string pointText(const Eigen::Vector3d& p) {
  return io::fixed(p.x(), 3) + " " + io::fixed(p.y(), 3) + " " + io::fixed(p.z(), 3);
}

// "3: 2 mapped, 1 unresolved", of the natural ones or the others.
std::string statesText(const slam::Map& map, bool natural) {
  int all = 0;
  std::map<std::string, int> counts;
  for (const auto& [id, marker] : map.markers()) {
    if (slam::isPicture(id) != natural) continue;
    ++all;
    ++counts[stateText(marker.state)];
  }
  std::string text;
  for (const auto& [state, count] : counts) {
    text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + state;
  }
  return std::to_string(all) + ": " + (text.empty() ? "none" : text) + "\n";
}

std::string sizesText(const slam::Map& map) {
  std::map<double, int> counts;  // by size
  for (const auto& [id, marker] : map.markers()) {
    if (!slam::isPicture(id)) ++counts[marker.size_m];
  }
  std::string text;
  for (const auto& [size_m, count] : counts) {
    text +=
        (text.empty() ? "" : ", ") + std::to_string(count) + " of " + io::roundTrip(size_m) + " m";
  }
  return text;
}

std::string extentText(const slam::Map& map) {
  Eigen::AlignedBox3d box;
  for (const io::MarkerCorners& marker : io::posedMarkerCorners(map)) {
    for (const Eigen::Vector3d& corner : marker.corners) box.extend(corner);
  }
  if (box.isEmpty()) return {};
  return "extent      " + pointText(box.sizes()) + " m, from " + pointText(box.min()) + " to " +
         pointText(box.max()) + "\n";
}

std::string keyframesText(const slam::Map& map) {
  std::string text = "keyframes   " + std::to_string(map.keyframes().size());
  std::size_t detections = 0;
  for (const auto& [id, keyframe] : map.keyframes()) detections += keyframe.detections.size();
  if (detections > 0) text += ", " + std::to_string(detections) + " views of markers";
  return text + "\n";
}

std::string cameraText(const std::optional<slam::Calibration>& camera) {
  if (!camera) return "camera      none\n";
  return "camera      " + sizeText(camera->width, camera->height) + ", fx " +
         io::fixed(camera->fx, 2) + " fy " + io::fixed(camera->fy, 2) + " cx " +
         io::fixed(camera->cx, 2) + " cy " + io::fixed(camera->cy, 2) +
         (camera->model == slam::DistortionModel::kEquidistant ? ", equidistant\n" : "\n");
}

// Largest standard deviations in the world, of position and orientation; empty where not known.
std::string sigmaText(const slam::MapMarker& marker) {
  if (marker.world_covariance.isZero(0.0)) return {};
  const slam::Vector6d variances = marker.world_covariance.diagonal();
  const double position_m = std::sqrt(variances.head<3>().maxCoeff());
  const double rotation_rad = std::sqrt(variances.tail<3>().maxCoeff());
  return "  sigma " + io::fixed(1e3 * position_m, 2) + " mm " +
         io::fixed(rotation_rad * 180.0 / std::numbers::pi, 3) + " deg";
}

// Of the position in the world: the median marker's, and the worst.
std::string uncertaintyText(const slam::Map& map) {
  std::vector<double> sigmas_m;
  for (const auto& [id, marker] : map.markers()) {
    if (!marker.T_w_m || marker.world_covariance.isZero(0.0)) continue;
    sigmas_m.push_back(std::sqrt(marker.world_covariance.diagonal().head<3>().maxCoeff()));
  }
  if (sigmas_m.empty()) return {};
  std::ranges::sort(sigmas_m);
  return "sigma       of " + std::to_string(sigmas_m.size()) + " markers in the world: median " +
         io::fixed(1e3 * sigmas_m[sigmas_m.size() / 2], 2) + " mm, worst " +
         io::fixed(1e3 * sigmas_m.back(), 2) + " mm\n";
}

std::string markerText(const slam::MapMarker& marker, std::size_t views,
                       const ReprojectionFit& fit) {
  const bool natural = slam::isPicture(marker.id);
  std::string text = "  " + (natural ? io::oneLine(marker.picture) : std::to_string(marker.id)) +
                     "  " + stateText(marker.state) + "  " + io::roundTrip(marker.size_m);
  text += natural ? " x " + io::roundTrip(marker.height_m) + " m" : " m";
  if (marker.T_w_m) {
    const Eigen::Quaterniond q = marker.T_w_m->quaternion();
    text += "  p " + pointText(marker.T_w_m->p) + "  q " + io::fixed(q.w(), 4) + " " +
            io::fixed(q.x(), 4) + " " + io::fixed(q.y(), 4) + " " + io::fixed(q.z(), 4);
  }
  text += sigmaText(marker);
  text += "  " + std::to_string(views) + " views";
  if (fit.corners > 0) text += "  " + io::fixed(fit.rms_px, 3) + " px";
  if (marker.other_T_w_m) text += "  ambiguous";
  if (!marker.former_poses.empty()) {
    text += "  moved " + std::to_string(marker.former_poses.size()) + " times";
  }
  return text + "\n";
}

// Of the first piece in the file.
std::string pieceInfo(const io::MapFile& file, bool with_markers) {
  const slam::Map& map = file.map;
  std::string text = "dictionary  " + map.dictionary + "\n";
  text += "markers     " + statesText(map, false);
  if (const std::string sizes = sizesText(map); !sizes.empty()) {
    text += "sizes       " + sizes + "\n";
  }
  const bool any_natural = !map.markers().empty() && slam::isPicture(map.markers().rbegin()->first);
  if (any_natural) text += "natural     " + statesText(map, true);
  text += extentText(map) + uncertaintyText(map) + keyframesText(map);
  if (const ReprojectionFit fit = reprojectionFit(file); fit.corners > 0) {
    text += "fit         " + io::fixed(fit.rms_px, 3) + " px rms over " +
            std::to_string(fit.corners) + " corners\n";
  }
  text += cameraText(file.camera);
  text += std::string("checksum    ") + (file.has_checksum ? "right" : "none") + "\n";
  if (!with_markers) return text;
  auto fits = reprojectionFitByMarker(file);
  for (const auto& [id, marker] : map.markers()) {
    const auto views = slam::isPicture(id) ? map.linkedFrom(id) : map.viewsOf(id);
    text += markerText(marker, views.size(), fits[id]);
  }
  return text;
}

}  // namespace

ReprojectionFit reprojectionFit(const io::MapFile& file) {
  SquareSum all;
  for (const auto& [id, sum] : squareSums(file)) {
    all.corners += sum.corners;
    all.px2 += sum.px2;
  }
  return all.fit();
}

std::map<int, ReprojectionFit> reprojectionFitByMarker(const io::MapFile& file) {
  std::map<int, ReprojectionFit> fits;
  for (const auto& [id, sum] : squareSums(file)) fits[id] = sum.fit();
  return fits;
}

std::string mapInfo(const io::MapFile& file, bool with_markers) {
  if (file.other_pieces.empty()) return pieceInfo(file, with_markers);
  std::string text;
  const auto add = [&](const slam::Map& piece) {
    io::MapFile of_piece{.map = piece, .camera = file.camera, .has_checksum = file.has_checksum};
    text += (text.empty() ? "" : "\n") + std::string("piece ") + std::to_string(piece.piece) +
            ", a world of its own\n" + pieceInfo(of_piece, with_markers);
  };
  add(file.map);
  for (const slam::Map& piece : file.other_pieces) add(piece);
  return text;
}

}  // namespace waymark::tools
