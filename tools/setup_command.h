// `waymark setup`: from a camera and some markers to a configuration of waymarkd.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

void addSetupCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
