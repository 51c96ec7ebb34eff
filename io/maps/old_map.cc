#include "io/maps/old_map.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "slam/camera/lens_knowledge.h"
#include "slam/camera/undistort_map.h"

namespace waymark::io {
namespace {

// Two calibrations of one camera differ by a few pixels at the edge; another lens, by far more.
constexpr double kMaxDifferencePerWidth = 0.01;
constexpr double kRounding_px = 1e-6;

Status checkMarkers(const slam::Map& map, const OldMapUse& use) {
  if (map.dictionary != use.dictionary) {
    return Error{"dictionary: is " + map.dictionary + ", but " + use.dictionary + " is looked for"};
  }
  for (const auto& [id, marker] : map.markers()) {
    constexpr double kSame = 1e-6;
    const double wanted_m = use.markers.sizeOf(id);
    if (slam::isPicture(id) || use.markers.isIgnored(id) ||
        std::abs(marker.size_m - wanted_m) <= kSame * wanted_m) {
      continue;
    }
    return Error{"markers: marker " + std::to_string(id) + " has a side of " +
                 roundTrip(marker.size_m) + " m there, but " + roundTrip(wanted_m) + " m here"};
  }
  return success();
}

bool sameSize(const slam::Calibration& a, const slam::Calibration& b) {
  return a.width == b.width && a.height == b.height;
}

// What was given allows for the lens that the map has measured, and knows less of it.
bool knowsLensBetter(const slam::Calibration& of_map, const slam::Calibration& given) {
  if (!of_map.covariance) return false;
  if (given.covariance && !((*of_map.covariance)(0, 0) < (*given.covariance)(0, 0))) return false;
  return !slam::LensPrior{}.isContradicted(slam::CameraModel(given), slam::CameraModel(of_map));
}

// Empty where the camera that is there holds. Who only localizes may have another camera than the
// one that the map was made with.
std::optional<slam::Calibration> lensOf(const MapFile& map, const OldMapUse& use) {
  if (!map.camera || !sameSize(*map.camera, use.camera)) return std::nullopt;
  if (use.lens_given) {
    const bool better = !use.localize_only && knowsLensBetter(*map.camera, use.camera);
    return better ? map.camera : std::nullopt;
  }
  return use.localize_only ? asUnmeasured(slam::CameraModel(*map.camera)).calibration()
                           : *map.camera;
}

bool sameCamera(const slam::Calibration& a, const slam::Calibration& b) {
  const std::optional<double> difference_px = largestLensDifference_px(a, b);
  return difference_px && *difference_px <= kMaxDifferencePerWidth * a.width;
}

}  // namespace

void agreeOnReadout(OldMap* old, slam::Options* options) {
  slam::RollingShutterOptions& shutter = options->shutter;
  if (!shutter.readout_s) {
    shutter.learned_s = old->readout_s.value_or(0.0);
  } else if (options->mapping && old->file.readout_s != *shutter.readout_s) {
    old->file.readout_s = *shutter.readout_s;
    slam::undistortAgain(slam::CameraModel(*old->file.camera), *shutter.readout_s, &old->file.map);
  }
}

std::optional<double> largestLensDifference_px(const slam::Calibration& a,
                                               const slam::Calibration& b) {
  if (!sameSize(a, b) || a.model != b.model) return std::nullopt;
  constexpr int kSteps = 20;
  const slam::CameraModel from(a);
  const slam::CameraModel to(b);
  double largest = 0.0;
  for (int row = 0; row <= kSteps; ++row) {
    for (int column = 0; column <= kSteps; ++column) {
      const Eigen::Vector2d pixel(double(column) / kSteps * (a.width - 1),
                                  double(row) / kSteps * (a.height - 1));
      const auto normalized = from.undistort(pixel);
      if (!normalized) continue;  // outside the lens
      largest = std::max(largest, (to.distort(*normalized) - pixel).norm());
    }
  }
  return largest;
}

Result<std::optional<std::string>> changeCamera(const slam::Calibration& camera, MapFile* map) {
  const auto none = std::optional<std::string>();
  const auto before = std::exchange(map->camera, camera);
  if (!before) return none;
  const std::optional<double> difference_px = largestLensDifference_px(*before, camera);
  if (!difference_px) return Error{"camera: has another image size or lens model"};
  const std::string apart = "up to " + fixed(*difference_px, 2) + " px apart";
  if (!sameCamera(*before, camera)) {
    return Error{"camera: is another one, or badly calibrated: " + apart};
  }
  if (*difference_px < kRounding_px) return none;
  undistortAgain(slam::CameraModel(camera), map);
  return std::optional("camera: was calibrated differently, " + apart +
                       "; its corners are undistorted anew");
}

Result<OldMap> readOldMap(const std::filesystem::path& path, const OldMapUse& use) {
  Result<std::string> text = readTextFile(path, kMaxMapBytes);
  if (!text) return text.error();
  return parseOldMap(std::move(text).value(), path, use);
}

Result<OldMap> parseOldMap(std::string text, const std::filesystem::path& path,
                           const OldMapUse& use) {
  Result<MapFile> file = parseMap(text, path);
  if (!file) return file.error();
  OldMap old{std::move(file).value(), std::move(text), {}, std::nullopt};
  const std::string name = path.string() + ": ";
  if (!old.file.has_checksum) old.warnings.push_back(name + "has no checksum: taken as it is");
  if (const Status fits = checkMarkers(old.file.map, use); !fits) {
    return Error{name + fits.error().message};
  }
  old.lens = lensOf(old.file, use);
  const slam::Calibration& camera = old.lens ? *old.lens : use.camera;
  if (old.file.readout_s != 0.0 && sameCamera(*old.file.camera, camera)) {
    old.readout_s = old.file.readout_s;
  }
  if (use.localize_only) {
    if (!old.file.map.empty()) return old;
    return Error{name + "markers: none has a pose, so there is nothing to localize in"};
  }
  if (old.lens) {
    if (const auto apart_px = largestLensDifference_px(*old.lens, use.camera);
        use.lens_given && apart_px && *apart_px > kRounding_px) {
      old.warnings.push_back(name +
                             "camera: going on with the lens as the map has learned it, up to " +
                             fixed(*apart_px, 2) + " px from the calibration that was given");
    }
    return old;
  }
  const auto changed = changeCamera(use.camera, &old.file);
  if (!changed) return Error{name + changed.error().message};
  if (*changed) old.warnings.push_back(name + **changed);
  return old;
}

}  // namespace waymark::io
