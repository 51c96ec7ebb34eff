#include "capture/eventlog/recording_name.h"

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <string_view>

namespace waymark::eventlog {
namespace {

constexpr std::size_t kDigits = 4;
constexpr std::string_view kClockSteps = "-c";

bool isDigit(char c) { return c >= '0' && c <= '9'; }

// "20261122T093000.250Z".
std::string timeText(std::int64_t utime) {
  const std::time_t seconds = utime / 1'000'000;
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y%m%dT%H%M%S", &parts);
  char milliseconds[32];
  std::snprintf(milliseconds, sizeof milliseconds, ".%03dZ", static_cast<int>(utime / 1000 % 1000));
  return std::string(text) + milliseconds;
}

bool isTimeText(std::string_view text) {
  constexpr std::string_view kForm = "00000000T000000.000Z";
  return text.size() == kForm.size() && std::ranges::equal(text, kForm, [](char c, char form) {
           return form == '0' ? isDigit(c) : c == form;
         });
}

// Takes `start` and four digits from the end of the text; -1 when they are not there.
int takeNumber(std::string_view start, std::string_view* text) {
  if (text->size() < start.size() + kDigits) return -1;
  const std::string_view end = text->substr(text->size() - start.size() - kDigits);
  const std::string_view digits = end.substr(start.size());
  if (!end.starts_with(start) || !std::ranges::all_of(digits, isDigit)) return -1;
  text->remove_suffix(end.size());
  return std::stoi(std::string(digits));
}

std::string fourDigits(int number) {
  char text[16];
  std::snprintf(text, sizeof text, "%04d", number);
  return text;
}

}  // namespace

std::string recordingName(const std::string& prefix, std::int64_t utime, int clock_steps) {
  const std::string steps =
      clock_steps > 0 ? std::string(kClockSteps) + fourDigits(clock_steps) : std::string();
  return prefix + "-" + timeText(utime) + steps;
}

std::string fileName(const std::string& recording, int number) {
  return recording + "-" + fourDigits(number) + kExtension;
}

std::optional<FileAge> fileAge(const std::string& prefix, std::string_view name) {
  if (!name.starts_with(prefix + "-") || !name.ends_with(kExtension)) return std::nullopt;
  name.remove_prefix(prefix.size() + 1);
  name.remove_suffix(std::string_view(kExtension).size());
  FileAge age;
  age.number = takeNumber("-", &name);
  if (age.number < 0) return std::nullopt;
  age.clock_steps = std::max(takeNumber(kClockSteps, &name), 0);
  age.began = name;
  return isTimeText(name) ? std::optional(age) : std::nullopt;
}

std::string nextRecording(const std::string& prefix, std::int64_t utime,
                          const std::optional<FileAge>& newest) {
  if (!newest) return recordingName(prefix, utime);
  const bool back = timeText(utime) < newest->began;
  return recordingName(prefix, utime,
                       std::min(newest->clock_steps + (back ? 1 : 0), kMaxClockSteps));
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
