#include "tools/ctl_command.h"

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>

#include <CLI/CLI.hpp>
#include <unistd.h>

#include "daemon/control/socket_place.h"
#include "io/calibrations/calibration_file.h"
#include "io/text/json_node.h"
#include "io/text/number_text.h"
#include "tools/control_client.h"
#include "tools/exit_code.h"
#include "tools/number_arguments.h"
#include "tools/status_table.h"

namespace waymark::tools {
namespace {

using io::Json;

struct CtlOptions {
  std::string socket;       // empty: where daemons usually listen
  double timeout_s = 60.0;  // a large map takes its time
  std::string file;
  bool force = false;  // in the place of one that is there
  std::string action;
  std::string level;
  bool json = false;
  bool table = false;
};

std::string listed(const Json& keys) {
  std::string text;
  for (const Json& key : keys) text += (text.empty() ? "" : ", ") + key.get<std::string>();
  return text.empty() ? "nothing" : text;
}

// Programs read pipes.
bool wantsTable(const CtlOptions& options) {
  return options.table || (!options.json && ::isatty(STDOUT_FILENO) == 1);
}

// What people want to know of a reply that is good.
void print(const CtlOptions& options, const Json& request, Json reply) {
  reply.erase("ok");
  if (request["command"] == "status") {
    const std::string text = wantsTable(options) ? statusTable(reply) : reply.dump(2) + "\n";
    std::fputs(text.c_str(), stdout);
  } else if (request["command"] == "reload") {
    std::printf("applied: %s\nneeds a restart: %s\n", listed(reply["applied"]).c_str(),
                listed(reply["needs_restart"]).c_str());
  } else if (reply.contains("result")) {
    std::printf("%s\n", reply["result"].get<std::string>().c_str());
  }
}

// The first usual place where there is a socket.
Result<std::string> socketOf(const CtlOptions& options) {
  if (!options.socket.empty()) return options.socket;
  std::string places;
  for (const std::filesystem::path& place : daemon::usualSockets()) {
    std::error_code error;
    if (std::filesystem::is_socket(place, error)) return place.string();
    places += (places.empty() ? "" : ", ") + place.string();
  }
  return Error{"no daemon listens at " + places +
               "; is waymarkd running? --socket names another place (control.socket of its "
               "configuration)"};
}

// The daemon may write to its own directories only; the file is whoever asks's.
ExitCode saveCalibration(const CtlOptions& options) {
  const auto failed = [](const std::string& why, ExitCode code) {
    std::fprintf(stderr, "waymark ctl: %s\n", why.c_str());
    return code;
  };
  std::error_code error;
  if (std::filesystem::exists(options.file, error) && !options.force) {
    return failed(options.file + ": is there already; --force takes its place", kBadInput);
  }
  const Result<std::string> socket = socketOf(options);
  if (!socket) return failed(socket.error().message, kBadInput);
  const auto timeout = std::chrono::milliseconds(static_cast<int>(1000.0 * options.timeout_s));
  const Result<Json> status = askDaemon(*socket, {{"command", "status"}}, timeout);
  if (!status) return failed(status.error().message, kBadInput);
  const Json& lens = status->at("lens");
  if (lens.at("width") == 0) return failed("no frame has come yet", kRejected);
  const Result<Json> reply = askDaemon(*socket, {{"command", "calibration"}}, timeout);
  if (!reply) return failed(reply.error().message, kBadInput);
  const auto calibration =
      io::parseCalibration(reply->value("result", ""), "the daemon's calibration");
  if (!calibration) return failed(calibration.error().message, kRejected);
  const Status written = io::writeCalibration(options.file, *calibration);
  if (!written) return failed(written.error().message, kBadInput);
  std::printf("%s: the lens as %s, focal length %.2f px\n", options.file.c_str(),
              lens.at("state").get<std::string>().c_str(), calibration->fx);
  return kDone;
}

ExitCode ask(const CtlOptions& options, const Json& request) {
  const Result<std::string> socket = socketOf(options);
  if (!socket) {
    std::fprintf(stderr, "waymark ctl: %s\n", socket.error().message.c_str());
    return kBadInput;
  }
  const auto timeout = std::chrono::milliseconds(static_cast<int>(1000.0 * options.timeout_s));
  const Result<Json> reply = askDaemon(*socket, request, timeout);
  if (!reply) {
    std::fprintf(stderr, "waymark ctl: %s\n", reply.error().message.c_str());
    return kBadInput;
  }
  if (!reply->at("ok").get<bool>()) {
    const std::string reason = reply->value("error", "the daemon refuses, and does not say why");
    std::fprintf(stderr, "waymark ctl: %s\n", io::oneLine(reason).c_str());
    return kRejected;
  }
  print(options, request, *reply);
  return kDone;
}

}  // namespace

void addCtlCommand(CLI::App& app, int* exit_code) {
  auto options = std::make_shared<CtlOptions>();
  CLI::App* ctl = app.add_subcommand("ctl", "Ask a running daemon, or tell it what to do");
  ctl->add_option("--socket", options->socket,
                  "The daemon's control socket; else the service's (/run/waymark/control.sock), or "
                  "that of a daemon started by hand ($XDG_RUNTIME_DIR/waymark/control.sock)");
  ctl->add_option("--timeout", options->timeout_s, "Seconds to wait for the daemon's answer")
      ->check(numberFrom(0.1, 86400.0))
      ->capture_default_str();
  ctl->require_subcommand(1);
  const auto add = [&](const char* name, const char* what, auto arguments) {
    CLI::App* command = ctl->add_subcommand(name, what);
    command->fallthrough();  // --socket may also stand at the end
    command->callback([=] {
      Json request = {{"command", name}};
      arguments(&request);
      *exit_code = ask(*options, request);
    });
    return command;
  };
  const auto none = [](Json*) {};
  CLI::App* status = add("status", "Print how the daemon is doing", none);
  CLI::Option* json = status->add_flag("--json", options->json,
                                       "As JSON, which is also what is written into a pipe");
  status->add_flag("--table", options->table, "As a table, also into a pipe")->excludes(json);
  add("save-map", "Optimize the map and write it to slam.map_out", none);
  add("load-map", "Go on with another map", [options](Json* request) {
    // The daemon has a working directory of its own.
    if (!options->file.empty()) {
      (*request)["file"] = std::filesystem::absolute(options->file).string();
    }
  })->add_option("FILE", options->file, "Map; left out: the one that the daemon starts with");
  CLI::App* save_calibration = ctl->add_subcommand(
      "save-calibration", "Write the lens in use, as given or learned, into a calibration file");
  save_calibration->fallthrough();
  save_calibration->add_option("FILE", options->file, "Where to: calib.yml, of OpenCV's form")
      ->required();
  save_calibration->add_flag("--force", options->force, "Also in the place of a file");
  save_calibration->callback([options, exit_code] { *exit_code = saveCalibration(*options); });
  add("reset", "Forget the map and begin a new one", none);
  add("record", "Start or stop the recording",
      [options](Json* request) { (*request)["action"] = options->action; })
      ->add_option("ACTION", options->action, "start or stop")
      ->required()
      ->check(CLI::IsMember({"start", "stop"}));
  add("preview", "Have WAYMARK_PREVIEW sent for five seconds: small images, for people", none);
  add("reload", "Read the configuration again, as on SIGHUP", none);
  add("set-log-level", "Change what the daemon logs, until it is restarted or reloaded",
      [options](Json* request) { (*request)["level"] = options->level; })
      ->add_option("LEVEL", options->level, "error, warning, info or debug")
      ->required()
      ->check(CLI::IsMember({"error", "warning", "info", "debug"}));
}

}  // namespace waymark::tools
