// An old map to go on with: does it fit what is looked for, and with what camera?
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "io/maps/map_file.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/marker_options.h"
#include "slam/options.h"

namespace waymark::io {

struct OldMapUse {
  std::string dictionary;
  slam::MarkerOptions markers;
  slam::Calibration camera;
  bool lens_given = true;  // by somebody; else `camera` is a guess
  // The map will only be localized in: any camera will do.
  bool localize_only = false;
};

struct OldMap {
  MapFile file;
  std::string text;                   // of the file, byte for byte
  std::vector<std::string> warnings;  // each names the file
  // Of the camera's rolling shutter, seconds, where the map knows it and its camera is this one.
  std::optional<double> readout_s;
  // The map's lens, where it is to be in use instead of OldMapUse::camera: nobody has given one; or
  // what was given allows for it, and the map knows it better. Without a covariance it is the guess
  // to begin with.
  std::optional<slam::Calibration> lens{};
};

// Another dictionary, another size of a marker, nothing to localize in where that is all that is
// wanted and, where the map is to grow, another camera are errors. A camera that was only
// calibrated again (same image size and model, nowhere more than 1 % of the image's width apart) is
// a warning: the map's corners are then undistorted anew. So is a calibration that the map has
// found to be another one (OldMap::lens).
[[nodiscard]] Result<OldMap> readOldMap(const std::filesystem::path& path, const OldMapUse& use);
// The same from text; `path` is for messages.
[[nodiscard]] Result<OldMap> parseOldMap(std::string text, const std::filesystem::path& path,
                                         const OldMapUse& use);

// Learning goes on from the readout time that the map has learned. One that the options give holds
// for the map's keyframes, too, unless the map is only localized in.
void agreeOnReadout(OldMap* old, slam::Options* options);

// The farthest that two calibrations put one ray apart anywhere in the image, pixels. Empty for
// cameras that cannot be one: other image sizes or lens models.
[[nodiscard]] std::optional<double> largestLensDifference_px(const slam::Calibration& a,
                                                             const slam::Calibration& b);

// Gives the map's keyframes another camera, that of the SLAM or of the map they are merged with.
// Empty when it is the same; else a warning; or an error when it cannot be the same camera.
[[nodiscard]] Result<std::optional<std::string>> changeCamera(const slam::Calibration& camera,
                                                              MapFile* map);

}  // namespace waymark::io
