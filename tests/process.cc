#include "tests/process.h"

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <thread>
#include <utility>

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/temporary_directory.h"

namespace waymark::testing {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

std::string readFile(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

Process::Process(const std::vector<std::string>& command, std::filesystem::path stderr_file,
                 const std::filesystem::path& stdout_file)
    : stderr_file_(std::move(stderr_file)) {
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDERR_FILENO, stderr_file_.c_str(),
                                   O_WRONLY | O_CREAT | O_TRUNC, 0600);
  if (!stdout_file.empty()) {
    posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, stdout_file.c_str(),
                                     O_WRONLY | O_CREAT | O_TRUNC, 0600);
  }
  std::vector<char*> arguments;
  arguments.reserve(command.size() + 1);
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const int error = posix_spawnp(&pid_, arguments[0], &files, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&files);
  if (error != 0) throw std::runtime_error("cannot start " + command[0]);
}

Process::~Process() {
  if (exit_code_) return;
  signal(SIGKILL);
  wait(milliseconds(5000));
}

void Process::signal(int number) const { kill(pid_, number); }

std::optional<int> Process::wait(milliseconds timeout) {
  const auto until = steady_clock::now() + timeout;
  while (!exit_code_) {
    int status = 0;
    if (waitpid(pid_, &status, WNOHANG) == pid_) {
      exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    } else if (steady_clock::now() >= until) {
      break;
    } else {
      std::this_thread::sleep_for(milliseconds(5));
    }
  }
  return exit_code_;
}

ProgramResult runProgram(const std::vector<std::string>& command) {
  constexpr std::chrono::minutes kPatience(10);
  const TemporaryDirectory directory;
  Process process(command, directory / "err", directory / "out");
  const int exit_code = process.wait(kPatience).value_or(-1);
  return {exit_code, readFile(directory / "out"), readFile(directory / "err")};
}

std::size_t openDescriptors(pid_t process) {
  constexpr int kLooks = 10;
  const std::filesystem::path directory = "/proc/" + std::to_string(process) + "/fd";
  std::size_t fewest = std::numeric_limits<std::size_t>::max();
  for (int i = 0; i < kLooks; ++i) {
    const std::filesystem::directory_iterator entries(directory);
    fewest =
        std::min(fewest, static_cast<std::size_t>(std::distance(begin(entries), end(entries))));
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return fewest;
}

}  // namespace waymark::testing
