// What configuration files tell the SLAM: the section [slam] of the daemon's file, which
// `waymark run --config` reads as well.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "base/result.h"
#include "io/settings/settings_file.h"
#include "slam/options.h"

namespace waymark::io {

// Where the daemon's map comes from and goes to. `waymark run` has options for that.
struct MapSettings {
  std::filesystem::path in;    // empty: begin a new map
  std::filesystem::path out;   // written at the end; empty: nowhere
  bool localize_only = false;  // leave the map of `in` as it is
  int save_interval_s = 300;   // of the daemon, when the map has changed; 0: only at the end
};

struct SlamSettings {
  std::string dictionary;
  slam::Options options = beginningPieces();  // what uses these says the piece of every pose
  MapSettings map;

 private:
  static slam::Options beginningPieces() {
    slam::Options options;
    options.pieces.begin = true;
    return options;
  }
};

// The keys of [slam]: "slam." and the path in slam::Options, but for dictionary, marker_size_m,
// what is in [slam.markers], and the map's files. Dictionary and marker size are required.
[[nodiscard]] std::vector<Setting> slamSettingKeys(SlamSettings& target);

// The section [slam] of a file that may be a whole daemon's. Here nothing is required: what is not
// in the file stays empty or at its default, and the caller knows where else it may come from.
[[nodiscard]] Result<SlamSettings> readSlamSettings(const std::filesystem::path& file);

// The same from text; `file` is for errors, and relative paths count from where it is.
[[nodiscard]] Result<SlamSettings> parseSlamSettings(const std::string& text,
                                                     const std::filesystem::path& file);

// Of an origin marker and anchors that are not in the dictionary: which, and why they cannot be.
// They would never be seen, and the world would be another one. Empty when all are, or there is no
// dictionary yet.
[[nodiscard]] std::string foreignMarkersReason(const SlamSettings& settings);

// The objection to a name that slam::Dictionary does not know lists those it knows.
[[nodiscard]] ValidationError validateDictionary(const std::string& name);

}  // namespace waymark::io
