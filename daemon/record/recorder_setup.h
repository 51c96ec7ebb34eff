// The recorder as the configuration wants it.
#pragma once

#include <filesystem>
#include <memory>

#include "base/result.h"
#include "daemon/configuration.h"
#include "daemon/maps/map_keeper.h"
#include "daemon/natural/natural_setup.h"
#include "daemon/record/recorder.h"
#include "daemon/system/log.h"
#include "slam/geometry/camera_model.h"

namespace waymark::daemon {

[[nodiscard]] RecorderOptions recorderOptions(const Configuration::Record& record);

// What the recorder could not do on any day: record where a file is, or frames larger than its
// buffer takes.
[[nodiscard]] Status checkRecorder(const Configuration::Record& record,
                                   const slam::Calibration& calibration);

// Null without a directory to record into. The recordings will carry the configuration file, the
// calibration as it is used, what the SLAM is told of natural markers, and the map that the daemon
// begins with, so that they can be run again without anything else.
[[nodiscard]] std::unique_ptr<Recorder> makeRecorder(
    const Configuration& configuration, const std::filesystem::path& configuration_file,
    const slam::Calibration& calibration, const StartMap& start, const NaturalSetup& natural,
    const Log& log);

}  // namespace waymark::daemon
