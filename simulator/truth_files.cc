#include "simulator/truth_files.h"

#include <cmath>
#include <set>
#include <string>

#include "io/calibrations/calibration_file.h"
#include "simulator/projected_marker.h"
#include "slam/detection/marker_detection.h"

namespace waymark::simulator {

std::vector<io::MarkerCorners> trueLayout(const Simulation& simulation) {
  std::vector<io::MarkerCorners> layout;
  std::set<int> listed;
  for (const Marker& marker : simulation.markers()) {
    if (!listed.insert(marker.id).second) continue;
    io::MarkerCorners truth{marker.id, marker.size_m, slam::markerCorners(marker.size_m)};
    for (Eigen::Vector3d& corner : truth.corners) corner = marker.T_w_m * corner;
    layout.push_back(truth);
  }
  return layout;
}

io::Trajectory trueTrajectory(const Simulation& simulation) {
  io::Trajectory trajectory;
  for (std::int64_t k = 0; k < simulation.frameCount(); ++k) {
    trajectory.push_back({std::llround(1e9 * simulation.timeOf(k)), simulation.poseAt(k)});
  }
  return trajectory;
}

std::vector<io::VisibleMarker> trueVisibility(const Simulation& simulation) {
  const slam::CameraModel camera(simulation.camera());
  std::vector<io::VisibleMarker> visible;
  for (std::int64_t k = 0; k < simulation.frameCount(); ++k) {
    if (simulation.isDark(k)) continue;
    const slam::Transform T_w_c = simulation.poseAt(k);
    for (const Marker& marker : simulation.visibleMarkers(k)) {
      // Has a value: the whole paper is in the image.
      const double side_px = shortestSide(projectMarker(camera, T_w_c, marker).value());
      visible.push_back({std::llround(1e9 * simulation.timeOf(k)), marker.id, side_px});
    }
  }
  return visible;
}

Status writeStaticTruth(const std::filesystem::path& directory, const Simulation& simulation) {
  Status status = io::writeCalibration(directory / "calib.yml", simulation.camera());
  if (!status) return status;
  const Scene& scene = simulation.scene();
  const std::string note = "simulated " + scene.name + ", markers of " + scene.dictionary.name() +
                           ": exact corners (TL TR BR BL), metres, in the frame of gt_traj.txt";
  return io::writeMarkerLayout(directory / "gt_map.json", trueLayout(simulation), note);
}

}  // namespace waymark::simulator
