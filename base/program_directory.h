// Where the program that runs is.
#pragma once

#include <filesystem>
#include <system_error>

namespace waymark {

// Its directory, wherever it was installed or built; empty where the system does not say.
[[nodiscard]] inline std::filesystem::path programDirectory() {
  std::error_code error;
  return std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
}

}  // namespace waymark
