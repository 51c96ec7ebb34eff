// `waymark cameras`: what cameras there are, and what they can do.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

// Sets *exit_code when the command has run. It must live as long as `app`.
void addCamerasCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
