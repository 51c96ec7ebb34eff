// The map across restarts: read when the daemon starts, written now and then, and when it stops.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "daemon/configuration.h"
#include "io/settings/slam_settings.h"
#include "slam/geometry/camera_model.h"
#include "slam/slam.h"

namespace waymark::daemon {

struct StartMap {
  slam::Map map;                      // empty: begin anew
  std::vector<slam::Map> others;      // of a map in pieces, those after the first
  std::string text;                   // of its file, byte for byte
  std::vector<std::string> warnings;  // for the log
  std::vector<std::string> notes;     // likewise: what came from where
  std::string not_writable;           // why slam.map_out is not, for now; usually empty
  slam::Options options;              // with what the map knows of the camera
  // The lens to begin with, where it is the map's and not the one that was asked for.
  std::optional<slam::Calibration> lens{};
};

// A SLAM that begins with a map, in pieces or not.
[[nodiscard]] std::unique_ptr<slam::Slam> makeSlam(const io::SlamSettings& settings,
                                                   const slam::Calibration& camera,
                                                   const slam::Options& options, slam::Map map,
                                                   std::vector<slam::Map> others = {});

// The map as text, all pieces of it.
[[nodiscard]] std::string mapText(const slam::Slam& slam);

// The map before the one in a file, kept by saving.
[[nodiscard]] std::filesystem::path previousOf(const std::filesystem::path& map_file);

// The map that a reset or load-map has replaced; kept beside the file.
[[nodiscard]] std::filesystem::path replacedOf(const std::filesystem::path& map_file);

// Reads slam.map_in, checks that it fits the markers and the camera, and that slam.map_out can be
// written: a wrong place is an error; a disk that is read-only, full or faulty is a warning, as it
// is no reason not to localize. Where the file is damaged or missing and the one before it is good,
// that one is taken. A missing file is an error, except where map_in and map_out are the same: then
// this is the first start.
[[nodiscard]] Result<StartMap> readStartMap(const io::SlamSettings& settings,
                                            const slam::Calibration& camera);

// Reads another file to go on with, and checks it likewise.
[[nodiscard]] Result<StartMap> readOtherMap(const std::filesystem::path& file,
                                            const io::SlamSettings& settings,
                                            const slam::Calibration& camera);

// Writes the map to slam.map_out, if it has changed. The map that was there is kept as
// previousOf(); after a power cut at any time, one of the two is whole. Returns what became of it,
// for the log.
[[nodiscard]] Result<std::string> writeMap(const io::SlamSettings& settings,
                                           const slam::Slam& slam);

// Optimizes the whole map and writes it. Without a map nothing is written. Returns what became of
// it; empty without a map_out.
[[nodiscard]] Result<std::string> saveMap(const io::SlamSettings& settings, slam::Slam& slam);

}  // namespace waymark::daemon
