// Names of the files of a recording: "waymark-20261122T093000.250Z-0003.lcmlog" is the fourth file
// of what began then, by the clock as it was. Their order is that of time as long as the clock only
// goes forward. Where it does not (a computer without one begins in 1970), a counter says so:
// "waymark-19700101T000012.000Z-c0001-0003.lcmlog" came after all without one, and so will those
// that follow; the higher counter is always the newer file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace waymark::eventlog {

inline constexpr const char* kExtension = ".lcmlog";
inline constexpr int kMaxFiles = 10'000;  // of one recording

inline constexpr int kMaxClockSteps = 9'999;  // four digits

// utime: when the recording began, microseconds since 1970. clock_steps: how often the clock had
// gone back. Without the file's number.
[[nodiscard]] std::string recordingName(const std::string& prefix, std::int64_t utime,
                                        int clock_steps = 0);

// number: from 0, less than kMaxFiles.
[[nodiscard]] std::string fileName(const std::string& recording, int number);

// What a name says; in the order in which files were made.
struct FileAge {
  int clock_steps = 0;
  std::string began;  // as in the name
  int number = 0;

  auto operator<=>(const FileAge&) const = default;
};
// Empty for names that no file of such a recording has.
[[nodiscard]] std::optional<FileAge> fileAge(const std::string& prefix, std::string_view name);

// The name of a recording that begins now, after all those of which `newest` is the last file.
[[nodiscard]] std::string nextRecording(const std::string& prefix, std::int64_t utime,
                                        const std::optional<FileAge>& newest);

// The file with which the recording goes on after this one, whether or not it is there. Empty for
// names of other kinds, and after the last possible one.
[[nodiscard]] std::filesystem::path nextFile(const std::filesystem::path& file);

}  // namespace waymark::eventlog
