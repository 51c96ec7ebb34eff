// The `waymark` command: a table of subcommands, each in a file of its own.
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "io/text/number_text.h"
#include "tools/calibrate_command.h"
#include "tools/cameras_command.h"
#include "tools/ctl_command.h"
#include "tools/echo_command.h"
#include "tools/eval_command.h"
#include "tools/exit_code.h"
#include "tools/map_command.h"
#include "tools/natural_command.h"
#include "tools/print_command.h"
#include "tools/record_command.h"
#include "tools/run_command.h"
#include "tools/simulate_command.h"

namespace {

// CLI11 only says that a command is missing, also where there is a word that is none. Empty when
// that is not what is wrong.
std::string unknownCommand(const CLI::App& app) {
  const std::vector<CLI::App*> given = app.get_subcommands();
  if (!given.empty()) return unknownCommand(*given.front());
  const std::vector<std::string> left = app.remaining();
  if (app.get_require_subcommand_min() == 0 || left.empty() || left.front().starts_with('-')) {
    return {};
  }
  std::string known;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    known += (known.empty() ? "" : ", ") + command->get_name();
  }
  return "'" + left.front() + "' is no command of " + app.get_name() + "; there are " + known;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace waymark::tools;
  int exit_code = kDone;
  CLI::App app{"Marker SLAM: metric camera poses from printed markers.", "waymark"};
  app.set_version_flag("--version", "waymark " WAYMARK_VERSION);
  app.require_subcommand(1);
  addRunCommand(app, &exit_code);
  addRecordCommand(app, &exit_code);
  addEvalCommand(app, &exit_code);
  addEchoCommand(app, &exit_code);
  addCtlCommand(app, &exit_code);
  addSimulateCommand(app, &exit_code);
  addCamerasCommand(app, &exit_code);
  addMapCommand(app, &exit_code);
  addNaturalCommand(app, &exit_code);
  addCalibrateCommand(app, &exit_code);
  addPrintCommand(app, &exit_code);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);  // --help and --version
    const std::string unknown = unknownCommand(app);
    const std::string fault = unknown.empty() ? e.what() : unknown;
    std::fprintf(stderr, "waymark: %s\n", waymark::io::oneLine(fault).c_str());
    return kBadInput;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "waymark: internal error: %s\n", waymark::io::oneLine(e.what()).c_str());
    return kInternalError;
  }
  return exit_code;
}
