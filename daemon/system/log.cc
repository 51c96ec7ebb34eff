#include "daemon/system/log.h"

#include <algorithm>
#include <cstdlib>
#include <string>

#include <sys/stat.h>
#include <unistd.h>

namespace waymark::daemon {
namespace {

// After the program's name.
std::string_view urgency(LogLevel level) {
  switch (level) {
    case LogLevel::kError:
      return "error: ";
    case LogLevel::kWarning:
      return "warning: ";
    case LogLevel::kInfo:
      return "";
    case LogLevel::kDebug:
      return "debug: ";
  }
  return "";
}

std::string formatLine(LogLevel level, std::string_view text, const std::string& program,
                       bool for_journal) {
  std::string line;
  if (for_journal) {
    line.append("<").append(std::to_string(static_cast<int>(level))).append(">");
  } else {
    line.append(program).append(": ").append(urgency(level));
  }
  line += text;
  line += '\n';
  return line;
}

}  // namespace

std::string_view nameOf(LogLevel level) {
  const auto* const found =
      std::ranges::find(kLogLevelNames, level, [](const auto& pair) { return pair.second; });
  return found == kLogLevelNames.end() ? "" : found->first;
}

std::optional<LogLevel> logLevelByName(std::string_view name) {
  const auto* const found =
      std::ranges::find(kLogLevelNames, name, [](const auto& pair) { return pair.first; });
  if (found == kLogLevelNames.end()) return std::nullopt;
  return found->second;
}

bool Log::journalListens() {
  // The variable is inherited by every child; it means this stderr only when it names it.
  const char* stream = std::getenv("JOURNAL_STREAM");  // NOLINT(concurrency-mt-unsafe): at start
  struct stat file {};
  if (stream == nullptr || fstat(STDERR_FILENO, &file) != 0) return false;
  return std::string_view(stream) ==
         std::to_string(file.st_dev) + ":" + std::to_string(file.st_ino);
}

void Log::writeBehind() {
  // The writer may outlive this object.
  const auto loss_line = [program = program_, for_journal = for_journal_](std::uint64_t lost) {
    const std::string text = std::to_string(lost) + " lines of the log lost, as nobody read them";
    return formatLine(LogLevel::kWarning, text, program, for_journal);
  };
  writer_ = std::make_unique<LineWriter>(STDERR_FILENO, loss_line);
}

void Log::drain() const {
  if (writer_) writer_->drain();
}

std::uint64_t Log::lost() const { return writer_ ? writer_->lost() : 0; }

void Log::write(LogLevel level, std::string_view text) const {
  if (level > this->level()) return;
  std::string line = formatLine(level, text, program_, for_journal_);
  if (writer_) {
    writer_->add(std::move(line));
    return;
  }
  // A failed write has nobody to be told.
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, line.data(), line.size());
}

}  // namespace waymark::daemon
