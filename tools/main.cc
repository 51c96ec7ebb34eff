// The `waymark` command: a table of subcommands, each in a file of its own.
#include <cstdio>
#include <exception>
#include <string>

#include <CLI/CLI.hpp>

#include "io/text/number_text.h"
#include "tools/calibrate_command.h"
#include "tools/cameras_command.h"
#include "tools/ctl_command.h"
#include "tools/doctor_command.h"
#include "tools/echo_command.h"
#include "tools/eval_command.h"
#include "tools/exit_code.h"
#include "tools/map_command.h"
#include "tools/natural_command.h"
#include "tools/print_command.h"
#include "tools/record_command.h"
#include "tools/run_command.h"
#include "tools/setup_command.h"
#include "tools/simulate_command.h"
#include "tools/usage_fault.h"
#include "tools/view_command.h"

int main(int argc, char** argv) {
  using namespace waymark::tools;
  int exit_code = kDone;
  CLI::App app{"Marker SLAM: metric camera poses from printed markers.", "waymark"};
  app.set_version_flag("--version", "waymark " WAYMARK_VERSION);
  app.require_subcommand(1);
  addSetupCommand(app, &exit_code);
  addRunCommand(app, &exit_code);
  addDoctorCommand(app, &exit_code);
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
  addViewCommand(app, &exit_code);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);  // --help and --version
    const std::string fault = usageFault(app, e.what());
    std::fprintf(stderr, "waymark: %s\n", waymark::io::oneLine(fault).c_str());
    return kBadInput;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "waymark: internal error: %s\n", waymark::io::oneLine(e.what()).c_str());
    return kInternalError;
  }
  return exit_code;
}
