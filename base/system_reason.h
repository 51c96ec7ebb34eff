// Why the system rejected, in its own words.
#pragma once

#include <cerrno>
#include <string>
#include <system_error>

namespace waymark {

// "No such file or directory" and the like, of errno as it stands.
[[nodiscard]] inline std::string systemReason(int error = errno) {
  return std::generic_category().message(error);
}

}  // namespace waymark
