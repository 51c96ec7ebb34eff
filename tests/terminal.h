// A program at a terminal, which somebody types at. Tests only.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

namespace waymark::testing {

class Terminal {
 public:
  explicit Terminal(const std::vector<std::string>& command);
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;
  ~Terminal();

  // Waits until this stands behind what has been waited for before; false where it never does.
  [[nodiscard]] bool shows(const std::string& text);
  // As keys do: "\n" is return, "\x03" Ctrl-C, "\x04" the end.
  void type(const std::string& keys) const;
  // The exit code; -1 where a signal ended it, empty where it does not end.
  [[nodiscard]] std::optional<int> wait();
  // All of it so far.
  [[nodiscard]] const std::string& screen() const { return screen_; }

 private:
  // False where nothing more came within `patience`.
  bool read(std::chrono::milliseconds patience);

  int master_ = -1;
  pid_t pid_ = -1;
  std::optional<int> exit_code_;
  std::string screen_;
  std::size_t looked_ = 0;  // up to here
};

}  // namespace waymark::testing
