// `waymark eval`: how far a trajectory and a map are from the truth.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

// Sets *exit_code when the command has run. It must live as long as `app`.
void addEvalCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
