// Runs a program and catches what it says. Tests only.
#pragma once

#include <cstdio>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include <sys/wait.h>
#include <unistd.h>

#include "tests/temporary_directory.h"

namespace waymark::testing {

struct ProgramResult {
  int exit_code = -1;  // -1 when it was killed by a signal
  std::string out;
  std::string err;
};

inline std::string readFile(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

inline ProgramResult runProgram(const std::string& program, std::vector<std::string> arguments) {
  const TemporaryDirectory directory;
  const pid_t child = fork();
  if (child == 0) {
    std::vector<char*> argv;
    arguments.insert(arguments.begin(), program);
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    const bool redirected = std::freopen((directory / "out").c_str(), "w", stdout) != nullptr &&
                            std::freopen((directory / "err").c_str(), "w", stderr) != nullptr;
    if (redirected) execv(program.c_str(), argv.data());
    _exit(127);
  }
  int status = 0;
  waitpid(child, &status, 0);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, readFile(directory / "out"),
          readFile(directory / "err")};
}

}  // namespace waymark::testing
