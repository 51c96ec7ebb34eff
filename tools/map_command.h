// `waymark map`: what is in maps, maps of other programs, and maps joined.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

// Sets *exit_code when the command has run. It must live as long as `app`.
void addMapCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
