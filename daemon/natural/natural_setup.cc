#include "daemon/natural/natural_setup.h"

#include <utility>

#include "io/pictures/natural_marker_set.h"
#include "io/pictures/print_file.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

Result<io::NaturalMarkerSet> readMarkers(const fs::path& file, const Configuration& configuration) {
  const fs::path& markers = configuration.relocalizer.markers;
  if (!markers.empty()) return io::readNaturalMarkers(markers);
  std::vector<io::NaturalMarkerEntry> entries;
  for (const Configuration::NaturalMarker& marker : configuration.natural) {
    io::NaturalMarkerEntry entry{.name = marker.name,
                                 .image = marker.image,
                                 .width_m = marker.width_m,
                                 .height_m = marker.height_m,
                                 .T_w_m = {}};
    if (marker.has_position) entry.T_w_m = marker.T_w_m;
    entries.push_back(std::move(entry));
  }
  return io::readNaturalMarkers(std::move(entries), file);
}

}  // namespace

Result<NaturalSetup> prepareNatural(const fs::path& configuration_file,
                                    Configuration* configuration) {
  NaturalSetup setup;
  const fs::path& markers = configuration->relocalizer.markers;
  if (configuration->natural.empty() && markers.empty()) return setup;
  Result<io::NaturalMarkerSet> set = readMarkers(configuration_file, *configuration);
  if (!set) return set.error();
  const fs::path& said_in = markers.empty() ? configuration_file : markers;
  setup.notes = set->notes;
  setup.alike = io::alikeNote(*set, said_in);
  setup.prints = io::formatPrints(io::printsOf(*set));
  Result<std::vector<slam::PicturePrint>> prints =
      io::parsePrints(setup.prints, configuration_file);
  if (!prints) return prints.error();
  slam::Options& options = configuration->slam.options;
  options.natural.prints = std::move(*prints);
  if (const std::string reason = options.invalidReason(); !reason.empty()) {
    return Error{said_in.string() + ": " + reason};
  }
  setup.pictures = io::picturesOf(std::move(*set));
  return setup;
}

}  // namespace waymark::daemon
