#include "tests/daemon_process.h"

#include <fcntl.h>
#include <sched.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>
#include <stdexcept>
#include <thread>
#include <utility>

#include "daemon/lcm_link.h"

namespace waymark::tests {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

TemporaryDirectory::TemporaryDirectory() {
  std::string pattern = (fs::temp_directory_path() / "waymark_XXXXXX").string();
  if (mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("mkdtemp: " + pattern);
  path_ = pattern;
}

TemporaryDirectory::~TemporaryDirectory() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

fs::path TemporaryDirectory::write(const std::string& name, const std::string& text) const {
  std::ofstream(path_ / name) << text;
  return path_ / name;
}

Process::Process(const std::vector<std::string>& command, fs::path stderr_file)
    : stderr_file_(std::move(stderr_file)) {
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDERR_FILENO, stderr_file_.c_str(),
                                   O_WRONLY | O_CREAT | O_TRUNC, 0600);
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

std::string Process::stderrText() const {
  std::ifstream file(stderr_file_);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::string randomUrl() {
  std::random_device random;
  const unsigned port = 20'000 + random() % 40'000;
  return "udpm://239.255.76.67:" + std::to_string(port) + "?ttl=0";
}

bool ensureMulticastRoute() {
  const auto address = daemon::multicastAddress(randomUrl());
  if (daemon::hasRoute(*address)) return true;
  if (unshare(CLONE_NEWNET) != 0) return false;
  return std::system("ip link set lo up && ip link set lo multicast on && "
                     "ip route add 224.0.0.0/4 dev lo") == 0 &&
         daemon::hasRoute(*address);
}

}  // namespace waymark::tests
