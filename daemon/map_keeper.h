// The map across restarts: read when the daemon starts, written when it stops.
#pragma once

#include <string>
#include <vector>

#include "base/result.h"
#include "daemon/configuration.h"
#include "io/slam_settings.h"
#include "slam/geometry/camera_model.h"
#include "slam/slam.h"

namespace waymark::daemon {

struct StartMap {
  slam::Map map;                   // empty: begin anew
  std::string text;                // of its file, byte for byte
  std::vector<std::string> notes;  // for the log: what came from where
  slam::Options options;           // with what the map knows of the camera
};

// Reads slam.map_in, checks that it fits the markers and the camera, and that slam.map_out can be
// written. A missing file is an error, except where map_in and map_out are the same: then this is
// the first start.
[[nodiscard]] Result<StartMap> readStartMap(const io::SlamSettings& settings,
                                            const slam::Calibration& camera);

// Optimises the whole map and writes it to slam.map_out: the old file or the new one is there,
// whatever happens. Without a map nothing is written. Returns what became of it, for the log; empty
// without a map_out.
[[nodiscard]] Result<std::string> saveMap(const io::SlamSettings& settings, slam::Slam& slam);

}  // namespace waymark::daemon
