#include "simulator/truth_files.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <set>
#include <system_error>

#include "slam/detection/marker_detection.h"

namespace waymark::simulator {
namespace {

// printf into a string.
template <typename... Args>
std::string format(const char* pattern, Args... args) {
  char text[512];
  std::snprintf(text, sizeof text, pattern, args...);
  return text;
}

}  // namespace

std::string calibrationText(const slam::Calibration& c) {
  std::string text = "%YAML:1.0\n---\n";
  text += format("image_width: %d\nimage_height: %d\n", c.width, c.height);
  text += "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n";
  text += format("   data: [ %.17g, 0., %.17g, 0., %.17g, %.17g, 0., 0., 1. ]\n", c.fx, c.cx, c.fy,
                 c.cy);
  text += "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n";
  const auto& d = c.distortion;  // the simulator's lenses have k1 k2 p1 p2 k3 only
  text += format("   data: [ %.17g, %.17g, %.17g, %.17g, %.17g ]\n", d[0], d[1], d[2], d[3], d[4]);
  return text;
}

std::string mapText(const Simulation& simulation) {
  std::string text = "{\"note\": \"simulated " + simulation.scene().name +
                     ": exact corners (TL TR BR BL), metres, in the frame of gt_traj.txt\",\n"
                     " \"dictionary\": \"" +
                     simulation.scene().dictionary.name() + "\",\n \"markers\": [";
  std::set<int> listed;
  for (const Marker& marker : simulation.markers()) {
    if (!listed.insert(marker.id).second) continue;
    text += format("%s\n  {\"id\": %d, \"size\": %.9g, \"corners\": [",
                   listed.size() == 1 ? "" : ",", marker.id, marker.size_m);
    const auto corners = slam::markerCorners(marker.size_m);
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const Eigen::Vector3d p_w = marker.T_w_m * corners[i];
      text += format("%s[%.9f, %.9f, %.9f]", i == 0 ? "" : ", ", p_w.x(), p_w.y(), p_w.z());
    }
    text += "]}";
  }
  text += "\n ]\n}\n";
  return text;
}

std::string trajectoryLine(std::string_view seconds, const slam::Transform& T_w_c) {
  const Eigen::Quaterniond q = T_w_c.quaternion();
  return std::string(seconds) + format(" %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n", T_w_c.p.x(),
                                       T_w_c.p.y(), T_w_c.p.z(), q.x(), q.y(), q.z(), q.w());
}

std::string trajectoryText(const Simulation& simulation) {
  std::string text;
  for (std::int64_t k = 0; k < simulation.frameCount(); ++k) {
    text += trajectoryLine(format("%.9f", simulation.timeOf(k)), simulation.poseAt(k));
  }
  return text;
}

Status writeWholeFile(const std::filesystem::path& path, std::string_view content) {
  const std::filesystem::path partial = path.string() + ".partial";
  errno = 0;
  std::ofstream file(partial, std::ios::binary);
  file.write(content.data(), static_cast<std::streamsize>(content.size()));
  file.close();
  if (!file) {
    const Error error{path.string() + ": cannot write: " + std::strerror(errno)};
    std::error_code ignored;
    std::filesystem::remove(partial, ignored);
    return error;
  }
  std::error_code failed;
  std::filesystem::rename(partial, path, failed);
  if (failed) return Error{path.string() + ": cannot write: " + failed.message()};
  return success();
}

}  // namespace waymark::simulator
