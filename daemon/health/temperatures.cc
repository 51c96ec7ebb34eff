#include "daemon/health/temperatures.h"

#include <algorithm>
#include <fstream>
#include <system_error>

namespace waymark::daemon {

namespace fs = std::filesystem;

std::vector<temperature_t> readTemperatures(const fs::path& root) {
  std::vector<temperature_t> temperatures;
  std::error_code error;
  for (fs::directory_iterator zone(root, error), end; !error && zone != end;
       zone.increment(error)) {
    if (!zone->path().filename().string().starts_with("thermal_zone")) continue;
    temperature_t temperature;
    double millidegrees = 0.0;
    if (std::getline(std::ifstream(zone->path() / "type"), temperature.name) &&
        std::ifstream(zone->path() / "temp") >> millidegrees) {
      temperature.celsius = 1e-3 * millidegrees;
      temperatures.push_back(std::move(temperature));
    }
  }
  std::ranges::sort(temperatures, {}, &temperature_t::name);
  return temperatures;
}

}  // namespace waymark::daemon
