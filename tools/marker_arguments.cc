#include "tools/marker_arguments.h"

#include <utility>

#include <CLI/CLI.hpp>

#include "io/settings/marker_ids.h"
#include "io/text/number_text.h"
#include "tools/number_arguments.h"

namespace waymark::tools {
namespace {

Status takeDictionary(const MarkerArguments& arguments, io::SlamSettings* settings) {
  if (arguments.dictionary.empty()) return success();
  if (const auto objection = io::validateDictionary(arguments.dictionary)) {
    return Error{"--dictionary: " + *objection};
  }
  settings->dictionary = arguments.dictionary;
  return success();
}

Status takeSizes(const MarkerArguments& arguments, slam::MarkerOptions* markers) {
  if (!arguments.marker_size.empty()) {
    const std::optional<double> size_m = io::parseDouble(arguments.marker_size);
    // As in the configuration.
    if (!size_m || !(*size_m >= 1e-3 && *size_m <= 100.0)) {
      const std::string millimetres =
          size_m && *size_m > 100.0
              ? "; " + arguments.marker_size + " mm are " + io::roundTrip(1e-3 * *size_m)
              : "";
      return Error{"--marker-size: '" + arguments.marker_size +
                   "' must be a number of metres, from 0.001 to 100" + millimetres};
    }
    markers->size_m = *size_m;
  }
  if (arguments.sizes.empty()) return success();
  auto sizes = io::parseMarkerSizes(arguments.sizes);
  if (!sizes) return Error{"--sizes: " + sizes.error().message};
  markers->other_sizes = std::move(sizes).value();
  return success();
}

Status takeRoles(const MarkerArguments& arguments, slam::MarkerOptions* markers) {
  if (!arguments.ignore.empty()) {
    auto ignored = io::parseIdRanges(arguments.ignore);
    if (!ignored) return Error{"--ignore: " + ignored.error().message};
    markers->ignored = std::move(ignored).value();
  }
  if (!arguments.origin_marker) return success();
  markers->origin_marker = arguments.origin_marker;
  markers->anchors.clear();  // the file's; both fix the world
  return success();
}

}  // namespace

void addMarkerArguments(CLI::App& command, MarkerArguments& arguments) {
  command.add_option("--dictionary", arguments.dictionary,
                     "Marker dictionary, e.g. APRILTAG_36h11");
  command.add_option("--marker-size", arguments.marker_size,
                     "Side of the printed black square, metres");
  command.add_option("--sizes", arguments.sizes,
                     "Sides of markers that are larger or smaller, metres: 10-19=0.2,42=0.05");
  command.add_option("--ignore", arguments.ignore, "Ids that are not used: 3,7-9");
  command
      .add_option("--origin-marker", arguments.origin_marker,
                  "The id of the marker whose frame is the world")
      ->check(wholeNumberFrom(0, 1'000'000));
  command.add_option("--config", arguments.config,
                     "Take the section [slam] of this configuration file (waymarkd's); the command "
                     "line wins");
}

Result<io::SlamSettings> slamSettings(const MarkerArguments& arguments,
                                      const std::optional<io::SlamSettings>& recorded) {
  io::SlamSettings settings = recorded.value_or(io::SlamSettings{});
  if (!arguments.config.empty()) {
    Result<io::SlamSettings> read = io::readSlamSettings(arguments.config);
    if (!read) return read.error();
    settings = std::move(read).value();
  }
  slam::MarkerOptions& markers = settings.options.markers;
  if (const Status taken = takeDictionary(arguments, &settings); !taken) return taken.error();
  if (const Status taken = takeSizes(arguments, &markers); !taken) return taken.error();
  if (const Status taken = takeRoles(arguments, &markers); !taken) return taken.error();
  const std::string where = arguments.config.empty() ? "" : " here or in " + arguments.config;
  if (settings.dictionary.empty()) return Error{"--dictionary is required" + where};
  if (markers.size_m == 0.0) return Error{"--marker-size is required" + where};
  if (const std::string reason = settings.options.invalidReason(); !reason.empty()) {
    return Error{(arguments.config.empty() ? "" : arguments.config + ": slam: ") + reason};
  }
  if (const std::string reason = io::foreignMarkersReason(settings); !reason.empty()) {
    return Error{reason};
  }
  return settings;
}

}  // namespace waymark::tools
