// Lines for people, on stderr: plain on a terminal, with the journal's <N> priorities under
// systemd. Not for the SLAM loop or any other thread's per-frame path.
#pragma once

#include <string_view>

namespace waymark::daemon {

// Values are syslog priorities, as the journal wants them.
enum class LogLevel { kError = 3, kWarning = 4, kInfo = 6, kDebug = 7 };

// Safe to use from several threads: each line is one write.
class Log {
 public:
  // Lines less urgent than `level` are left out. `for_journal`: begin each line with <N>.
  Log(LogLevel level, bool for_journal) : level_(level), for_journal_(for_journal) {}

  // True when stderr goes to the systemd journal.
  [[nodiscard]] static bool journalListens();

  void error(std::string_view text) const { write(LogLevel::kError, text); }
  void warning(std::string_view text) const { write(LogLevel::kWarning, text); }
  void info(std::string_view text) const { write(LogLevel::kInfo, text); }
  void debug(std::string_view text) const { write(LogLevel::kDebug, text); }

 private:
  void write(LogLevel level, std::string_view text) const;

  LogLevel level_;
  bool for_journal_;
};

}  // namespace waymark::daemon
