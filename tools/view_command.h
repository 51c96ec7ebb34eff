// `waymark view`: runs waymark-view, a program and a package of its own.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

void addViewCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
