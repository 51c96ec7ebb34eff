// A waymarkd of its own for a test: configuration, process, and what it said on stderr.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace waymark::tests {

namespace fs = std::filesystem;

// A directory that is removed with this object.
class TemporaryDirectory {
 public:
  TemporaryDirectory();
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  ~TemporaryDirectory();

  [[nodiscard]] const fs::path& path() const { return path_; }
  // Writes a file into it; gives its path.
  fs::path write(const std::string& name, const std::string& text) const;

 private:
  fs::path path_;
};

// A program with its stderr kept in a file. Killed with this object if it still runs.
class Process {
 public:
  Process(const std::vector<std::string>& command, fs::path stderr_file);
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  ~Process();

  [[nodiscard]] pid_t pid() const { return pid_; }
  void signal(int number) const;
  // The exit code; empty when it still runs after `timeout`, -1 when a signal killed it.
  std::optional<int> wait(std::chrono::milliseconds timeout);
  [[nodiscard]] std::string stderrText() const;

 private:
  pid_t pid_ = -1;
  fs::path stderr_file_;
  std::optional<int> exit_code_;
};

// A group and port that nobody else is likely to use at the same time.
[[nodiscard]] std::string randomUrl();

// Is there a multicast route? If not, makes this process a network of its own where there is one.
// False when that is not allowed either.
[[nodiscard]] bool ensureMulticastRoute();

}  // namespace waymark::tests
