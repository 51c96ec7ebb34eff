#include "daemon/control/socket_place.h"

#include <cstdlib>
#include <string>
#include <utility>

#include <sys/stat.h>
#include <unistd.h>

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

constexpr const char* kName = "control.sock";

// Empty where it is not set.
std::string environment(const char* name) {
  const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): before there are threads
  return value == nullptr ? std::string() : std::string(value);
}

bool isOwnDirectory(const fs::path& path) {
  struct stat status {};
  return ::stat(path.c_str(), &status) == 0 && S_ISDIR(status.st_mode) &&
         status.st_uid == ::geteuid();
}

}  // namespace

fs::path serviceSocket() {
  const std::string all = environment("RUNTIME_DIRECTORY");  // with colons between several
  if (all.empty()) return {};
  return fs::path(all.substr(0, all.find(':'))) / kName;
}

fs::path userSocket() {
  fs::path directory = environment("XDG_RUNTIME_DIR");
  if (directory.empty()) directory = "/run/user/" + std::to_string(::geteuid());
  if (!directory.is_absolute() || !isOwnDirectory(directory)) return {};
  return directory / "waymark" / kName;
}

std::vector<fs::path> usualSockets() {
  std::vector<fs::path> places = {fs::path("/run/waymark") / kName};
  if (fs::path own = userSocket(); !own.empty()) places.push_back(std::move(own));
  return places;
}

}  // namespace waymark::daemon
