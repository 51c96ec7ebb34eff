// The SLAM's map as a file: map.json, with everything that is needed to go on with it later.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"
#include "io/maps/marker_corners.h"
#include "io/maps/posed_markers.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"

namespace waymark::io {

struct MapFile {
  slam::Map map;
  // Of a map in pieces: those after the first, each with its own world (slam::Map::piece).
  std::vector<slam::Map> other_pieces{};
  // What the keyframes were taken with; a map without keyframes may have none.
  std::optional<slam::Calibration> camera;
  // First to last row of that camera, seconds; 0 for a global shutter.
  double readout_s = 0.0;
  // Where the markers come from a file that says it.
  std::optional<FieldSize> field{};
  // False when the file has no checksum: somebody edited it and took the line out.
  bool has_checksum = true;
};

// {"format":"waymark-map","version":1,"checksum",...,"dictionary",...,"camera":{...},
// "field":{...} (where it is known),"markers":[...],"unposed_markers":[...],"keyframes":[...]}, one
// marker or keyframe a line. Markers and keyframes of a piece other than 0 say its number; where
// there are several pieces, those of the first come first, and a marker of one may be among the
// unposed ones of others. Equal maps, equal bytes; and a map that was read gives the bytes it
// was read from. Precondition: all numbers are finite; a map with keyframes has a camera.
[[nodiscard]] std::string formatMap(const slam::Map& map,
                                    const std::optional<slam::Calibration>& camera,
                                    double readout_s = 0.0,
                                    const std::optional<FieldSize>& field = {},
                                    std::span<const slam::Map* const> other_pieces = {});
// Of a map in pieces, the first one first. Precondition: there is one.
[[nodiscard]] std::string formatMap(std::span<const slam::Map> pieces,
                                    const std::optional<slam::Calibration>& camera,
                                    double readout_s, const std::optional<FieldSize>& field);
[[nodiscard]] std::string formatMap(const MapFile& file);

// The corners of all pieces anew, through that lens, with the file's readout time.
void undistortAgain(const slam::CameraModel& camera, MapFile* file);

// Checks the checksum, every type, number and reference. The error is one line: file, place,
// reason.
[[nodiscard]] Result<MapFile> parseMap(const std::string& text, const std::filesystem::path& file);
// More is no map: one of 2,000 markers and 6,000 keyframes has some 100 MB, and reading one takes
// several times as much memory.
inline constexpr std::size_t kMaxMapBytes = std::size_t{256} << 20U;

[[nodiscard]] Result<MapFile> readMap(const std::filesystem::path& path);

}  // namespace waymark::io
