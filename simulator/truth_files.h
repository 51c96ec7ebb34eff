// The truth as files, in the formats of the recordings: calib.yml (OpenCV FileStorage),
// gt_map.json, gt_traj.txt (TUM: camera in world) and gt_visible.csv (what is in view).
#pragma once

#include <filesystem>
#include <vector>

#include "base/result.h"
#include "io/maps/map_file.h"
#include "io/maps/visible_markers.h"
#include "io/trajectory.h"
#include "simulator/simulation.h"

namespace waymark::simulator {

// Where the markers are at the start. Of a doubled id only the original is listed.
[[nodiscard]] std::vector<io::MarkerCorners> trueLayout(const Simulation& simulation);

// The whole trajectory, frame k at k / rate.
[[nodiscard]] io::Trajectory trueTrajectory(const Simulation& simulation);

// Simulation::visibleMarkers() of every frame with light.
[[nodiscard]] std::vector<io::VisibleMarker> trueVisibility(const Simulation& simulation);

// calib.yml and gt_map.json: what is known before the first frame. An Error names the file and the
// system's reason.
[[nodiscard]] Status writeStaticTruth(const std::filesystem::path& directory,
                                      const Simulation& simulation);

}  // namespace waymark::simulator
