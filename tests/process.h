// Programs as their users start them, with what they say kept in files. Tests only.
#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

namespace waymark::testing {

[[nodiscard]] std::string readFile(const std::filesystem::path& path);

// A running program. Killed with this object if it still runs.
class Process {
 public:
  // stdout stays the test's own where no file is given.
  Process(const std::vector<std::string>& command, std::filesystem::path stderr_file,
          const std::filesystem::path& stdout_file = {});
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  ~Process();

  [[nodiscard]] pid_t pid() const { return pid_; }
  void signal(int number) const;
  // The exit code; empty when it still runs after `timeout`, -1 when a signal killed it.
  std::optional<int> wait(std::chrono::milliseconds timeout);
  [[nodiscard]] std::string stderrText() const { return readFile(stderr_file_); }

 private:
  pid_t pid_ = -1;
  std::filesystem::path stderr_file_;
  std::optional<int> exit_code_;
};

// How many files a program has open. Some are open for a moment only: the fewest of several looks
// count, a second together.
[[nodiscard]] std::size_t openDescriptors(pid_t process);

struct ProgramResult {
  int exit_code = -1;  // -1 when a signal killed it, or when it did not come to an end
  std::string out;
  std::string err;
};

// Runs a program to its end.
[[nodiscard]] ProgramResult runProgram(const std::vector<std::string>& command);

}  // namespace waymark::testing
