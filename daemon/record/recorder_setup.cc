#include "daemon/record/recorder_setup.h"

#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "base/image_view.h"
#include "io/calibrations/calibration_file.h"

namespace waymark::daemon {

namespace fs = std::filesystem;
using capture::RecordedFile;

RecorderOptions recorderOptions(const Configuration::Record& record) {
  const auto bytes = [](int mib) { return static_cast<std::uint64_t>(mib) << 20U; };
  RecorderOptions options;
  options.log.directory = record.directory;
  options.log.file_bytes = bytes(record.file_mib);
  options.log.file_s = record.file_s;
  options.log.quota_bytes = bytes(record.quota_mib);
  options.log.keep_free_bytes = bytes(record.keep_free_mib);
  options.log.flush_ms = record.flush_ms;
  options.at_start = record.at_start;
  options.images = record.images;
  options.jpeg_quality = record.jpeg_quality;
  options.image_channel = record.image_channel;
  options.frame_buffer_bytes = bytes(record.buffer_mib);
  return options;
}

Status checkRecorder(const Configuration::Record& record, const slam::Calibration& calibration) {
  if (record.directory.empty()) return success();
  std::error_code error;
  const fs::file_status place = fs::status(record.directory, error);
  if (fs::exists(place) && !fs::is_directory(place)) {
    return Error{record.directory.string() + ": is a file, where recordings should go"};
  }
  const std::size_t needed = Recorder::leastBufferBytes(calibration.width, calibration.height);
  if (record.images && recorderOptions(record).frame_buffer_bytes < needed) {
    return Error{"record.buffer_mib: must be at least " + std::to_string((needed >> 20U) + 1) +
                 " for pictures of " + sizeText(calibration.width, calibration.height)};
  }
  return success();
}

std::unique_ptr<Recorder> makeRecorder(const Configuration& configuration,
                                       const fs::path& configuration_file,
                                       const slam::Calibration& calibration, const StartMap& start,
                                       const NaturalSetup& natural, const Log& log) {
  if (configuration.record.directory.empty()) return nullptr;
  std::vector<RecordedFile> files;
  files.push_back({RecordedFile::kConfiguration, configuration_file.string(), configuration.text});
  if (!lensIsUnknown(configuration)) {
    const fs::path& given = configuration.camera.calibration;
    files.push_back({RecordedFile::kCalibration,
                     given.empty() ? configuration.camera.source : given.string(),
                     io::formatCalibration(calibration)});
  }
  if (!start.text.empty()) {
    files.push_back({RecordedFile::kMap, configuration.slam.map.in.string(), start.text});
  }
  if (!natural.prints.empty()) {
    const fs::path& markers = configuration.relocalizer.markers;
    files.push_back({RecordedFile::kNatural,
                     (markers.empty() ? configuration_file : markers).string(), natural.prints});
  }
  return std::make_unique<Recorder>(recorderOptions(configuration.record), files, log);
}

}  // namespace waymark::daemon
