#include "daemon/maps/map_keeper.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <system_error>
#include <utility>

#include <unistd.h>

#include "io/maps/map_file.h"
#include "io/maps/old_map.h"
#include "io/text/text_file.h"
#include "slam/final_map.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

std::string contents(std::span<const slam::Map* const> pieces) {
  const auto is_posed_picture = [](const auto& id_and_marker) {
    return slam::isPicture(id_and_marker.first) && id_and_marker.second.T_w_m.has_value();
  };
  std::size_t markers = 0;
  std::size_t keyframes = 0;
  std::ptrdiff_t natural = 0;
  for (const slam::Map* const map : pieces) {
    markers += io::posedMarkerCorners(*map).size();
    keyframes += map->keyframes().size();
    natural += std::ranges::count_if(map->markers(), is_posed_picture);
  }
  return std::to_string(markers) + " markers, " +
         (natural > 0 ? std::to_string(natural) + " natural markers, " : "") +
         std::to_string(keyframes) + " keyframes" +
         (pieces.size() > 1 ? " in " + std::to_string(pieces.size()) + " pieces" : "");
}

std::string contents(const io::MapFile& file) {
  std::vector<const slam::Map*> pieces = {&file.map};
  for (const slam::Map& other : file.other_pieces) pieces.push_back(&other);
  return contents(pieces);
}

fs::path directoryOf(const fs::path& file) {
  return file.has_parent_path() ? file.parent_path() : fs::path(".");
}

Status checkWritable(const fs::path& file) {
  if (file.empty()) return success();
  std::error_code error;
  if (fs::is_directory(file, error)) return Error{file.string() + ": is a directory"};
  const auto output = io::OutputDirectory::open(directoryOf(file));
  return output ? success() : Status(output.error());
}

// Is it the disk, and not the configuration, that keeps us from writing there? It is read-only
// since it was not unmounted, or full, or failing, and may be better tomorrow.
bool diskRefuses(fs::path directory) {
  std::error_code error;
  while (!directory.empty() && !fs::is_directory(directory, error)) {
    directory = directory.parent_path();
  }
  std::string probe = ((directory.empty() ? "." : directory) / ".waymark-XXXXXX").string();
  if (::mkdtemp(probe.data()) != nullptr) {
    ::rmdir(probe.c_str());
    return false;
  }
  return errno == EROFS || errno == ENOSPC || errno == EDQUOT || errno == EIO;
}

// A file that can be read to its end as a map, whatever is in it.
bool isWhole(const fs::path& file) { return io::readMap(file).ok(); }

// What becomes of the map of a daemon when the power is cut while it is being written, or its disk
// is failing: the one before is used.
Result<StartMap> readWithPrevious(const fs::path& file, const io::SlamSettings& settings,
                                  const slam::Calibration& camera) {
  Result<StartMap> start = readOtherMap(file, settings, camera);
  // A whole map that does not fit is the wrong one, and so is the one before it.
  if (start || isWhole(file)) return start;
  Result<StartMap> previous = readOtherMap(previousOf(file), settings, camera);
  if (!previous) return start;
  previous->warnings.insert(previous->warnings.begin(),
                            start.error().message + "; using the map before it");
  return previous;
}

Result<StartMap> readConfiguredMap(const io::SlamSettings& settings,
                                   const slam::Calibration& camera) {
  const io::MapSettings& map = settings.map;
  StartMap start;
  start.options = settings.options;
  if (map.in.empty()) return start;
  std::error_code error;
  if (map.in == map.out && !fs::exists(map.in, error) && !error &&
      !fs::exists(previousOf(map.in), error)) {
    start.notes.push_back(map.in.string() + ": not there yet; beginning a new map");
    return start;
  }
  return readWithPrevious(map.in, settings, camera);
}

}  // namespace

std::unique_ptr<slam::Slam> makeSlam(const io::SlamSettings& settings,
                                     const slam::Calibration& camera, const slam::Options& options,
                                     slam::Map map, std::vector<slam::Map> others) {
  return std::make_unique<slam::Slam>(slam::CameraModel(camera),
                                      *slam::Dictionary::byName(settings.dictionary), options,
                                      std::move(map), std::move(others));
}

std::string mapText(const slam::Slam& slam) {
  return io::formatMap(slam::piecesThroughOneLens(slam), slam.lens().calibrationOf(slam.camera()),
                       slam.readout_s(), {});
}

fs::path previousOf(const fs::path& map_file) { return map_file.string() + ".previous"; }

fs::path replacedOf(const fs::path& map_file) { return map_file.string() + ".replaced"; }

Result<StartMap> readStartMap(const io::SlamSettings& settings, const slam::Calibration& camera) {
  const Status writable = checkWritable(settings.map.out);
  if (!writable && !diskRefuses(directoryOf(settings.map.out))) return writable.error();
  Result<StartMap> start = readConfiguredMap(settings, camera);
  if (!start || writable) return start;
  start->not_writable = writable.error().message;
  start->warnings.push_back(start->not_writable +
                            "; the map will be saved when it can be, poses come all the same");
  return start;
}

Result<StartMap> readOtherMap(const fs::path& file, const io::SlamSettings& settings,
                              const slam::Calibration& camera) {
  StartMap start;
  start.options = settings.options;
  const bool localize_only = settings.map.localize_only;
  // One that is in use, and known, is as good as given.
  const bool lens_given = settings.options.lens.given || camera.covariance.has_value();
  Result<io::OldMap> old = io::readOldMap(file, {.dictionary = settings.dictionary,
                                                 .markers = settings.options.markers,
                                                 .camera = camera,
                                                 .lens_given = lens_given,
                                                 .localize_only = localize_only});
  if (!old) return old.error();
  start.lens = std::move(old->lens);
  if (start.lens && !localize_only) start.options.lens.given = true;
  io::agreeOnReadout(&*old, &start.options);
  start.warnings = std::move(old->warnings);
  start.notes.push_back(file.string() + ": going on with " + contents(old->file));
  start.map = std::move(old->file.map);
  start.others = std::move(old->file.other_pieces);
  start.text = std::move(old->text);
  return start;
}

Result<std::string> writeMap(const io::SlamSettings& settings, const slam::Slam& slam) {
  const fs::path& file = settings.map.out;
  const std::string text = mapText(slam);
  const Result<std::string> before = io::readTextFile(file, io::kMaxMapBytes);
  const std::string what = contents(slam.pieces());
  if (before && *before == text) return file.string() + ": is as it was, " + what;
  // What is no whole map must not take the place of one that may be.
  const bool keep = before && io::parseMap(*before, file).ok();
  const Status written =
      keep ? io::writeTextFileKeeping(file, text, previousOf(file)) : io::writeTextFile(file, text);
  if (!written) return written.error();
  return file.string() + ": saved " + what;
}

Result<std::string> saveMap(const io::SlamSettings& settings, slam::Slam& slam) {
  const fs::path& file = settings.map.out;
  if (file.empty()) return std::string();
  if (slam.map().empty()) return file.string() + ": there is no map to save";
  slam::makeFinalMap({}, {}, &slam);
  return writeMap(settings, slam);
}

}  // namespace waymark::daemon
