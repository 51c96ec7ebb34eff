// What was simulated, for the record.
#pragma once

#include <string>

#include "simulator/simulation.h"

namespace waymark::simulator {

// Every option as used, the scene's own values filled in: a JSON object.
[[nodiscard]] std::string optionsText(const Simulation& simulation);

}  // namespace waymark::simulator
