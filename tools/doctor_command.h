// `waymark doctor`: looks at a source of images and says what a run would depend on.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

// Sets *exit_code when the command has run. It must live as long as `app`.
void addDoctorCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
