#include "daemon/maps/map_keeper.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
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

std::string contents(const slam::Map& map) {
  const auto is_posed_picture = [](const auto& id_and_marker) {
    return slam::isPicture(id_and_marker.first) && id_and_marker.second.T_w_m.has_value();
  };
  const auto natural = std::ranges::count_if(map.markers(), is_posed_picture);
  return std::to_string(io::posedMarkerCorners(map).size()) + " markers, " +
         (natural > 0 ? std::to_string(natural) + " natural markers, " : "") +
         std::to_string(map.keyframes().size()) + " keyframes";
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
                                     slam::Map map) {
  return std::make_unique<slam::Slam>(slam::CameraModel(camera),
                                      *slam::Dictionary::byName(settings.dictionary), options,
                                      std::move(map));
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
  Result<io::OldMap> old = io::readOldMap(file, {.dictionary = settings.dictionary,
                                                 .markers = settings.options.markers,
                                                 .camera = camera,
                                                 .localize_only = settings.map.localize_only});
  if (!old) return old.error();
  io::agreeOnReadout(&*old, &start.options);
  start.warnings = std::move(old->warnings);
  if (!old->file.other_pieces.empty()) {
    start.warnings.push_back(file.string() + ": has " +
                             std::to_string(1 + old->file.other_pieces.size()) +
                             " pieces, each with a world of its own; only piece " +
                             std::to_string(old->file.map.piece) + " is used");
  }
  start.notes.push_back(file.string() + ": going on with " + contents(old->file.map));
  start.map = std::move(old->file.map);
  start.text = std::move(old->text);
  return start;
}

Result<std::string> writeMap(const io::SlamSettings& settings, const slam::Map& map,
                             const slam::Calibration& camera, double readout_s) {
  const fs::path& file = settings.map.out;
  const std::string text = io::formatMap(map, camera, readout_s);
  const Result<std::string> before = io::readTextFile(file, io::kMaxMapBytes);
  if (before && *before == text) return file.string() + ": is as it was, " + contents(map);
  // What is no whole map must not take the place of one that may be.
  const bool keep = before && io::parseMap(*before, file).ok();
  const Status written =
      keep ? io::writeTextFileKeeping(file, text, previousOf(file)) : io::writeTextFile(file, text);
  if (!written) return written.error();
  return file.string() + ": saved " + contents(map);
}

Result<std::string> saveMap(const io::SlamSettings& settings, slam::Slam& slam) {
  const fs::path& file = settings.map.out;
  if (file.empty()) return std::string();
  if (slam.map().empty()) return file.string() + ": there is no map to save";
  slam::makeFinalMap({}, {}, &slam);
  return writeMap(settings, slam.map(), slam.camera().calibration(), slam.readout_s());
}

}  // namespace waymark::daemon
