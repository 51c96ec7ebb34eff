// Natural markers from the configuration, for those who need them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "base/result.h"
#include "daemon/configuration.h"
#include "slam/natural/pictures/natural_marker.h"

namespace waymark::daemon {

struct NaturalSetup {
  std::vector<slam::PosedNaturalMarker> pictures;  // for the relocalizer; none, and there is none
  std::string prints;                              // what the SLAM is told, for recordings
  std::vector<std::string> notes;                  // for the log
  std::string alike;  // a warning for it: which pictures look alike; usually empty
};

// Reads the pictures of [[natural]] or of relocalizer.markers, and tells `configuration` what the
// SLAM is to know of them: exactly what a recording of it says. The error is one line that names
// the picture.
[[nodiscard]] Result<NaturalSetup> prepareNatural(const std::filesystem::path& configuration_file,
                                                  Configuration* configuration);

}  // namespace waymark::daemon
