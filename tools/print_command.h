// `waymark print`: markers and calibration boards as PDF, true to scale.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

// Sets *exit_code when the command has run. It must live as long as `app`.
void addPrintCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
