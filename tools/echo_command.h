// `waymark echo`: prints the poses that subscribers get.
#pragma once

namespace CLI {
class App;
}

namespace waymark::tools {

// Adds the subcommand to `app`. Its outcome is left in `exit_code`.
void addEchoCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
