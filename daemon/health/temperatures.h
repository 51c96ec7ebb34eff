// The computer's own temperature sensors, where the kernel shows them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <waymark/temperature_t.hpp>

namespace waymark::daemon {

// Reads every thermal zone below `root`. Sensors that cannot be read are left out.
[[nodiscard]] std::vector<temperature_t> readTemperatures(
    const std::filesystem::path& root = "/sys/class/thermal");

}  // namespace waymark::daemon
