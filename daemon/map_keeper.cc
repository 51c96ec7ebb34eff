#include "daemon/map_keeper.h"

#include <filesystem>
#include <system_error>
#include <utility>

#include "io/map_file.h"
#include "io/old_map.h"
#include "io/text_file.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

std::string contents(const slam::Map& map) {
  return std::to_string(io::posedMarkerCorners(map).size()) + " markers, " +
         std::to_string(map.keyframes().size()) + " keyframes";
}

Status checkWritable(const fs::path& file) {
  if (file.empty()) return success();
  std::error_code error;
  if (fs::is_directory(file, error)) return Error{file.string() + ": is a directory"};
  const fs::path directory = file.has_parent_path() ? file.parent_path() : fs::path(".");
  const auto output = io::OutputDirectory::open(directory);
  return output ? success() : Status(output.error());
}

}  // namespace

Result<StartMap> readStartMap(const io::SlamSettings& settings, const slam::Calibration& camera) {
  const io::MapSettings& map = settings.map;
  if (const Status writable = checkWritable(map.out); !writable) return writable.error();
  StartMap start;
  start.options = settings.options;
  if (map.in.empty()) return start;
  std::error_code error;
  if (map.in == map.out && !fs::exists(map.in, error) && !error) {
    start.notes.push_back(map.in.string() + ": not there yet; beginning a new map");
    return start;
  }
  Result<io::OldMap> old = io::readOldMap(map.in, {.dictionary = settings.dictionary,
                                                   .markers = settings.options.markers,
                                                   .camera = camera,
                                                   .localise_only = map.localise_only});
  if (!old) return old.error();
  io::agreeOnReadout(&*old, &start.options);
  start.notes = std::move(old->warnings);
  start.notes.push_back(map.in.string() + ": going on with " + contents(old->file.map));
  start.map = std::move(old->file.map);
  start.text = std::move(old->text);
  return start;
}

Result<std::string> saveMap(const io::SlamSettings& settings, slam::Slam& slam) {
  const fs::path& file = settings.map.out;
  if (file.empty()) return std::string();
  if (slam.map().empty()) return file.string() + ": there is no map to save";
  slam.optimiseGlobally();
  const Status written = io::writeTextFile(
      file, io::formatMap(slam.map(), slam.camera().calibration(), slam.readout_s()));
  if (!written) return written.error();
  return file.string() + ": saved " + contents(slam.map());
}

}  // namespace waymark::daemon
