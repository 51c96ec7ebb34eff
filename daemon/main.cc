// waymarkd: camera in, poses out. Reads and checks everything there is to check, and hands it to
// the Daemon (daemon.h), where the wiring is.
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include <CLI/CLI.hpp>
#include <opencv2/core/utility.hpp>

#include "base/image_view.h"
#include "capture/libcamera/libcamera_source.h"
#include "daemon/configuration.h"
#include "daemon/control/control_server.h"
#include "daemon/control/reload_signal.h"
#include "daemon/control/socket_place.h"
#include "daemon/control/stop_signal.h"
#include "daemon/daemon.h"
#include "daemon/frames/camera_setup.h"
#include "daemon/maps/map_keeper.h"
#include "daemon/natural/natural_setup.h"
#include "daemon/record/recorder_setup.h"
#include "daemon/system/datagrams_only.h"
#include "daemon/system/log.h"
#include "io/text/number_text.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

enum ExitCode { kDone = 0, kFault = 1, kBadInput = 2 };

// The one that is configured, or the service's; null where there is neither. A daemon that somebody
// started by hand has one where `waymark ctl` looks for it, if that place is free: nobody asked for
// it, and a second such daemon runs without.
Result<std::unique_ptr<ControlServer>> openControl(const fs::path& wanted, const Log& log) {
  if (!wanted.empty()) return ControlServer::open(wanted);
  const fs::path place = userSocket();
  if (place.empty()) return std::unique_ptr<ControlServer>();
  std::error_code error;
  fs::create_directory(place.parent_path(), error);
  Result<std::unique_ptr<ControlServer>> opened = ControlServer::open(place);
  if (opened) return opened;
  log.info("no control socket: " + opened.error().message);
  return std::unique_ptr<ControlServer>();
}

fs::path wantedSocket(const Configuration& configuration) {
  return configuration.control.socket.empty() ? serviceSocket() : configuration.control.socket;
}

// What a good configuration comes to, in a few lines.
std::string describe(const fs::path& file, const Configuration& configuration,
                     const CameraSetup& camera) {
  const slam::Calibration& lens = camera.calibration;
  std::string text = file.string() + ": good\n";
  text +=
      "  camera   " + configuration.camera.source + ", " + sizeText(lens.width, lens.height) + "\n";
  text += "  markers  " + configuration.slam.dictionary + ", " +
          io::roundTrip(configuration.slam.options.markers.size_m) + " m\n";
  text += "  publish  " + configuration.publish.url + ", channels " +
          configuration.publish.channel_prefix + "...\n";
  if (const fs::path socket = wantedSocket(configuration); !socket.empty()) {
    text += "  control  " + socket.string() + "\n";
  }
  if (!configuration.slam.map.out.empty()) {
    text += "  map      " + configuration.slam.map.out.string() + "\n";
  }
  if (!configuration.record.directory.empty()) {
    text += "  record   " + configuration.record.directory.string() + "\n";
  }
  return text;
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
  if (!natural->alike.empty()) log.warning(natural->alike);
  Result<StartMap> start = readStartMap(configuration.slam, camera->calibration);
  if (!start) return start.error();
  if (const Status s = checkRecorder(configuration.record, camera->calibration); !s) {
    return s.error();
  }
  const fs::path socket = wantedSocket(configuration);
  if (check_only) {
    // A start would go on; whoever asks wants to know.
    if (!start->not_writable.empty()) return Error{start->not_writable};
    if (const Status s = ControlServer::checkPlace(socket); !s) return s.error();
    std::fputs(describe(file, configuration, *camera).c_str(), stdout);
    return std::optional<DaemonParts>();
  }
  StopSignal stop;
  std::unique_ptr<Recorder> recorder =
      makeRecorder(configuration, file, camera->calibration, *start, *natural, log);
  Result<std::unique_ptr<ControlServer>> control = openControl(socket, log);
  if (!control) return control.error();
  return std::optional(DaemonParts{.stop = std::move(stop),
                                   .configuration_file = file,
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
  app.add_flag("--check", check_only,
               "Check the configuration and what it names, say what they come to, then exit");
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
