// `waymark simulate`: a sequence with exact truth, as a recording.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

// Sets *exit_code when the command has run. It must live as long as `app`.
void addSimulateCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
