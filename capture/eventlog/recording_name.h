// Names of the files of a recording: "waymark-20261122T093000.250Z-0003.lcmlog" is the fourth file
// of what began then. Their order is that of time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace waymark::eventlog {

inline constexpr const char* kExtension = ".lcmlog";
inline constexpr int kMaxFiles = 10'000;  // of one recording

// utime: when the recording began, microseconds since 1970. Without the file's number.
[[nodiscard]] std::string recordingName(const std::string& prefix, std::int64_t utime);

// number: from 0, less than kMaxFiles.
[[nodiscard]] std::string fileName(const std::string& recording, int number);

// The file with which the recording goes on after this one, whether or not it is there. Empty for
// names of other kinds, and after the last possible one.
[[nodiscard]] std::filesystem::path nextFile(const std::filesystem::path& file);

}  // namespace waymark::eventlog
