// Files that a recording carries along, so that it can be run again without anything else.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"

namespace waymark::capture {

// In event logs a waymark.file_t, before everything else.
struct RecordedFile {
  static constexpr const char* kChannel = "WAYMARK_FILE";
  static constexpr const char* kConfiguration = "configuration";
  static constexpr const char* kCalibration = "calibration";
  static constexpr const char* kMap = "map";
  static constexpr const char* kNatural = "natural";  // natural markers, io/pictures/print_file.h

  std::string purpose;  // one of the above
  std::string name;     // as people know it
  std::string content;
};

[[nodiscard]] std::vector<std::uint8_t> encodeFile(const RecordedFile& file, std::int64_t utime);

// Empty when the bytes are no whole message of this kind.
[[nodiscard]] std::optional<RecordedFile> decodeFile(std::span<const std::uint8_t> bytes);

// Those that the log begins with; none when it begins with something else. Damage is no error: what
// is lost is not there. The error names the file and the reason.
[[nodiscard]] Result<std::vector<RecordedFile>> readRecordedFiles(const std::filesystem::path& log);

}  // namespace waymark::capture
