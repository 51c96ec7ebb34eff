#include "tests/terminal.h"

#include <array>
#include <csignal>
#include <cstddef>
#include <stdexcept>

#include <poll.h>
#include <pty.h>
#include <sys/wait.h>
#include <unistd.h>

namespace waymark::testing {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kPatience(60'000);

Terminal::Terminal(const std::vector<std::string>& command) {
  std::vector<char*> arguments;
  arguments.reserve(command.size() + 1);
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  pid_ = forkpty(&master_, nullptr, nullptr, nullptr);
  if (pid_ < 0) throw std::runtime_error("no terminal");
  if (pid_ == 0) {
    execv(arguments[0], arguments.data());
    _exit(127);
  }
}

Terminal::~Terminal() {
  if (!exit_code_) {
    kill(pid_, SIGKILL);
    (void)waitpid(pid_, nullptr, 0);
  }
  close(master_);
}

bool Terminal::read(milliseconds patience) {
  pollfd waiting{master_, POLLIN, 0};
  if (poll(&waiting, 1, static_cast<int>(patience.count())) <= 0) return false;
  std::array<char, 4096> buffer{};
  const ssize_t count = ::read(master_, buffer.data(), buffer.size());
  if (count <= 0) return false;  // EIO: nobody has it open any more
  screen_.append(buffer.data(), static_cast<std::size_t>(count));
  return true;
}

bool Terminal::shows(const std::string& text) {
  const auto until = steady_clock::now() + kPatience;
  for (;;) {
    const std::size_t found = screen_.find(text, looked_);
    if (found != std::string::npos) {
      looked_ = found + text.size();
      return true;
    }
    const auto left = std::chrono::duration_cast<milliseconds>(until - steady_clock::now());
    if (left.count() <= 0 || !read(left)) return false;
  }
}

void Terminal::type(const std::string& keys) const {
  if (write(master_, keys.data(), keys.size()) != static_cast<ssize_t>(keys.size())) {
    throw std::runtime_error("the terminal takes no keys");
  }
}

std::optional<int> Terminal::wait() {
  const auto until = steady_clock::now() + kPatience;
  while (!exit_code_ && steady_clock::now() < until) {
    (void)read(milliseconds(20));  // or it could wait for ever for somebody who reads
    int status = 0;
    if (waitpid(pid_, &status, WNOHANG) != pid_) continue;
    exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  while (read(milliseconds(50))) {
  }
  return exit_code_;
}

}  // namespace waymark::testing
