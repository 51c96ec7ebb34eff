#include "simulator/truth_files.h"

#include <cmath>
#include <set>
#include <string>

#include "io/calibration_file.h"
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

Status writeStaticTruth(const std::filesystem::path& directory, const Simulation& simulation) {
  Status status = io::writeCalibration(directory / "calib.yml", simulation.camera());
  if (!status) return status;
  const Scene& scene = simulation.scene();
  const std::string note = "simulated " + scene.name + ", markers of " + scene.dictionary.name() +
                           ": exact corners (TL TR BR BL), metres, in the frame of gt_traj.txt";
  return io::writeMarkerLayout(directory / "gt_map.json", trueLayout(simulation), note);
}

}  // namespace waymark::simulator
