// waymarkd: camera in, poses out. Reads and checks everything there is to check, and hands it to
// the Daemon (daemon.h), where the wiring is.
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include <CLI/CLI.hpp>
#include <opencv2/core/utility.hpp>

#include "capture/libcamera/libcamera_source.h"
#include "daemon/configuration.h"
#include "daemon/control/control_server.h"
#include "daemon/control/reload_signal.h"
#include "daemon/daemon.h"
#include "daemon/frames/camera_setup.h"
#include "daemon/maps/map_keeper.h"
#include "daemon/natural/natural_setup.h"
#include "daemon/record/recorder_setup.h"
#include "daemon/system/datagrams_only.h"
#include "daemon/system/log.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

enum ExitCode { kDone = 0, kFault = 1, kBadInput = 2 };

// Where systemd made a runtime directory for this service, the socket is in there.
fs::path controlSocket(const Configuration& configuration) {
  if (!configuration.control.socket.empty()) return configuration.control.socket;
  const char* directory = std::getenv("RUNTIME_DIRECTORY");  // NOLINT(concurrency-mt-unsafe)
  if (directory == nullptr || *directory == '\0') return {};
  const std::string_view all = directory;  // with colons between several
  return fs::path(all.substr(0, all.find(':'))) / "control.sock";
}

// Null where nobody wants a socket.
Result<std::unique_ptr<ControlServer>> openControl(const fs::path& socket) {
  if (socket.empty()) return std::unique_ptr<ControlServer>();
  return ControlServer::open(socket);
}

// Empty when all that was wanted was a check.
Result<std::optional<DaemonParts>> prepare(const fs::path& file, Configuration configuration,
                                           bool check_only, const Log& log) {
  Result<CameraSetup> camera = prepareCamera(configuration);
  if (!camera) return camera.error();
  if (!camera->calibration_change.empty()) {
    log.info(configuration.camera.calibration.string() + ": " + camera->calibration_change);
  }
  Result<NaturalSetup> natural = prepareNatural(file, &configuration);
  if (!natural) return natural.error();
  for (const std::string& note : natural->notes) log.info(note);
  Result<StartMap> start = readStartMap(configuration.slam, camera->calibration);
  if (!start) return start.error();
  if (const Status s = checkRecorder(configuration.record, camera->calibration); !s) {
    return s.error();
  }
  const fs::path socket = controlSocket(configuration);
  if (check_only) {
    // A start would go on; whoever asks wants to know.
    if (!start->not_writable.empty()) return Error{start->not_writable};
    if (const Status s = ControlServer::checkPlace(socket); !s) return s.error();
    return std::optional<DaemonParts>();
  }
  std::unique_ptr<Recorder> recorder =
      makeRecorder(configuration, file, camera->calibration, *start, *natural, log);
  Result<std::unique_ptr<ControlServer>> control = openControl(socket);
  if (!control) return control.error();
  return std::optional(DaemonParts{.configuration_file = file,
                                   .configuration = std::move(configuration),
                                   .camera = std::move(camera).value(),
                                   .start = std::move(start).value(),
                                   .natural = std::move(natural).value(),
                                   .recorder = std::move(recorder),
                                   .control = std::move(control).value()});
}

int run(const fs::path& file, bool check_only) {
  const ReloadSignal reload_signal;  // from the beginning: it must not end a daemon that starts
  const bool for_journal = Log::journalListens();
  const Result<Configuration> configuration = readConfiguration(file);
  if (!configuration) {
    Log(LogLevel::kError, for_journal).error(configuration.error().message);
    return kBadInput;
  }
  Log log(configuration->log.level, for_journal);
  if (const Status s = allowDatagramsOnly(); !s) log.warning(s.error().message);
  cv::setNumThreads(1);  // the SLAM loop is one thread, and it does not wait for others
  Result<std::optional<DaemonParts>> parts = prepare(file, *configuration, check_only, log);
  if (!parts) {
    log.error(parts.error().message);
    return kBadInput;
  }
  if (!*parts) return kDone;
  const capture::LibcameraMessages libcamera_messages(
      [&log](std::string_view line) { log.warning("libcamera: " + std::string(line)); });
  log.writeBehind();
  Daemon daemon(*std::move(parts).value(), reload_signal, log);
  const std::optional<Daemon::Failure> failure = daemon.run();
  if (!failure) return kDone;
  log.error(failure->error.message);
  return failure->input_is_bad ? kBadInput : kFault;
}

}  // namespace
}  // namespace waymark::daemon

int main(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);  // who reads the log may go, and the daemon stays
  CLI::App app{"Publishes metric camera poses from printed markers over LCM.", "waymarkd"};
  std::string configuration_file;
  bool check_only = false;
  app.add_option("--config", configuration_file, "Configuration file (TOML)")->required();
  app.add_flag("--check", check_only, "Check the configuration and what it names, then exit");
  app.set_version_flag("--version", "waymarkd " WAYMARK_VERSION);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);  // --help and --version
    std::fprintf(stderr, "waymarkd: %s\n", e.what());
    return waymark::daemon::kBadInput;
  }
  return waymark::daemon::run(configuration_file, check_only);
}
