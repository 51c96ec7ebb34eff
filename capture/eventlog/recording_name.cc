#include "capture/eventlog/recording_name.h"

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <string_view>

namespace waymark::eventlog {
namespace {

constexpr std::size_t kDigits = 4;

bool isDigit(char c) { return c >= '0' && c <= '9'; }

}  // namespace

std::string recordingName(const std::string& prefix, std::int64_t utime) {
  const std::time_t seconds = utime / 1'000'000;
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y%m%dT%H%M%S", &parts);
  char milliseconds[32];
  std::snprintf(milliseconds, sizeof milliseconds, ".%03dZ", static_cast<int>(utime / 1000 % 1000));
  return prefix + "-" + text + milliseconds;
}

std::string fileName(const std::string& recording, int number) {
  char text[16];
  std::snprintf(text, sizeof text, "-%04d", number);
  return recording + text + kExtension;
}

std::filesystem::path nextFile(const std::filesystem::path& file) {
  const std::string name = file.filename().string();
  const std::string_view stem = std::string_view(name).substr(0, name.rfind(kExtension));
  if (stem.size() == name.size() || stem.size() <= kDigits + 1) return {};
  const std::string_view digits = stem.substr(stem.size() - kDigits);
  if (!std::ranges::all_of(digits, isDigit) || stem[stem.size() - kDigits - 1] != '-') return {};
  const int next = std::stoi(std::string(digits)) + 1;
  if (next >= kMaxFiles) return {};
  const std::string recording(stem.substr(0, stem.size() - kDigits - 1));
  return file.parent_path() / fileName(recording, next);
}

}  // namespace waymark::eventlog
