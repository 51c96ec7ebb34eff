// `waymark ctl`: asks a running daemon for something, over its control socket.
#pragma once

namespace CLI {
class App;
}

namespace waymark::tools {

// Adds the subcommand to `app`. Its outcome is left in `exit_code`.
void addCtlCommand(CLI::App& app, int* exit_code);

}  // namespace waymark::tools
