// The command line's say about markers: dictionary, sizes, which to ignore, which is the world.
#pragma once

#include <optional>
#include <string>

#include <CLI/App.hpp>

#include "base/result.h"
#include "io/settings/slam_settings.h"

namespace waymark::tools {

struct MarkerArguments {
  std::string dictionary;
  std::string marker_size;  // as typed; metres
  std::string sizes;        // "10-19=0.2,42=0.05"
  std::string ignore;       // "3,7-9"
  std::optional<int> origin_marker;
  std::string config;
};

// `arguments` must live as long as `command`.
void addMarkerArguments(CLI::App& command, MarkerArguments& arguments);

// From the configuration file, or `recorded` where there is none, and the command line, which wins.
// Dictionary and marker size must come from one of them.
[[nodiscard]] Result<io::SlamSettings> slamSettings(
    const MarkerArguments& arguments, const std::optional<io::SlamSettings>& recorded = {});

}  // namespace waymark::tools
