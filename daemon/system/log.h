// Lines for people, on stderr: plain on a terminal, with the journal's <N> priorities under
// systemd. Not for what happens with every frame.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "daemon/system/line_writer.h"

namespace waymark::daemon {

// Values are syslog priorities, as the journal wants them.
enum class LogLevel { kError = 3, kWarning = 4, kInfo = 6, kDebug = 7 };

// As they are called in configurations and requests.
inline constexpr std::array<std::pair<std::string_view, LogLevel>, 4> kLogLevelNames = {
    {{"error", LogLevel::kError},
     {"warning", LogLevel::kWarning},
     {"info", LogLevel::kInfo},
     {"debug", LogLevel::kDebug}}};
[[nodiscard]] std::string_view nameOf(LogLevel level);
// Empty when there is no such level.
[[nodiscard]] std::optional<LogLevel> logLevelByName(std::string_view name);

// Safe to use from several threads: each line is one write.
class Log {
 public:
  // Lines less urgent than `level` are left out. `for_journal`: begin each line with <N>, otherwise
  // with the program's name.
  Log(LogLevel level, bool for_journal, std::string program = "waymarkd")
      : level_(level), for_journal_(for_journal), program_(std::move(program)) {}

  // From now on a thread of its own writes the lines: however long nobody reads stderr, nobody who
  // logs waits. What finds no room is lost, and counted. Before there are other threads.
  void writeBehind();
  // Waits until what was said is written, unless nobody reads it.
  void drain() const;
  // Lines that were lost.
  [[nodiscard]] std::uint64_t lost() const;

  // Any thread; holds from the next line on.
  void setLevel(LogLevel level) { level_.store(level, std::memory_order_relaxed); }
  [[nodiscard]] LogLevel level() const { return level_.load(std::memory_order_relaxed); }

  // True when stderr goes to the systemd journal.
  [[nodiscard]] static bool journalListens();

  void error(std::string_view text) const { write(LogLevel::kError, text); }
  void warning(std::string_view text) const { write(LogLevel::kWarning, text); }
  void info(std::string_view text) const { write(LogLevel::kInfo, text); }
  void debug(std::string_view text) const { write(LogLevel::kDebug, text); }

 private:
  void write(LogLevel level, std::string_view text) const;

  std::atomic<LogLevel> level_;
  const bool for_journal_;
  const std::string program_;
  std::unique_ptr<LineWriter> writer_;  // null: who logs writes
};

}  // namespace waymark::daemon
