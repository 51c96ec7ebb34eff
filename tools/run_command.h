// `waymark run`: the daemon's own SLAM loop over a recording, every frame, deterministically.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

// Sets *exit_code when the command has run. It must live as long as `app`.
void addRunCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
