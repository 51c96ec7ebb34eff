// `waymark record`: a camera into event logs, without SLAM.
#pragma once

#include <CLI/App.hpp>

namespace waymark::tools {

void addRecordCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
