// `waymark calibrate`: a camera from views of a printed board.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

// Sets *exit_code when the command has run. It must live as long as `app`.
void addCalibrateCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
