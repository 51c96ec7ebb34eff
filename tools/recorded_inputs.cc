#include "tools/recorded_inputs.h"

#include <utility>
#include <vector>

#include "capture/log_source.h"
#include "io/calibrations/calibration_file.h"
#include "io/pictures/print_file.h"

namespace waymark::tools {

using capture::RecordedFile;

Result<RecordedInputs> recordedInputs(const std::string& source) {
  RecordedInputs inputs;
  if (!capture::isEventLog(source)) return inputs;
  Result<std::vector<RecordedFile>> files = capture::readRecordedFiles(source);
  if (!files) return files.error();
  for (RecordedFile& file : files.value()) {
    const std::string name = source + ": " + file.name;
    if (file.purpose == RecordedFile::kCalibration) {
      const Result<slam::Calibration> calibration = io::parseCalibration(file.content, name);
      if (!calibration) return calibration.error();
      inputs.calibration = *calibration;
    } else if (file.purpose == RecordedFile::kConfiguration) {
      Result<io::SlamSettings> settings = io::parseSlamSettings(file.content, name);
      if (!settings) return settings.error();
      inputs.settings = std::move(settings).value();
    } else if (file.purpose == RecordedFile::kNatural) {
      Result<std::vector<slam::PicturePrint>> prints = io::parsePrints(file.content, name);
      if (!prints) return prints.error();
      inputs.prints = std::move(prints).value();
    } else if (file.purpose == RecordedFile::kMap) {
      file.name = name;
      inputs.map = std::move(file);
    }
  }
  return inputs;
}

}  // namespace waymark::tools
