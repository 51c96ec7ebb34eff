// `waymark natural`: files of natural markers, and how well their pictures will do.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

// Sets *exit_code when the command has run. It must live as long as `app`.
void addNaturalCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
