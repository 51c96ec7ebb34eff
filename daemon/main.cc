// waymarkd: camera in, poses out. This file is the wiring diagram:
//
//   capture thread --> [newest wins] --> SLAM thread --> [records, map] --> publisher thread
//        |                                 ^   ^                               |    |    |
//        |                         [errands]   nudges                      [health] v    |
//        |                                 |   '--- housekeeping thread <------'   LCM   |
//        |                     map thread -'             |       ^                       |
//        |                          ^---- [requests] ----'       '--- control socket     |
//        '--- [frames] ------------> recorder thread <------------- [messages] ----------'
//
// The main thread only waits. A stop travels the same way as a frame: capture closes its queue, the
// SLAM loop empties it, the publisher sends what is left, the recorder writes it down, and
// housekeeping tells what came of it.
#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include <CLI/CLI.hpp>
#include <opencv2/core/utility.hpp>
#include <pthread.h>

#include "base/clock.h"
#include "capture/open_source.h"
#include "daemon/camera_setup.h"
#include "daemon/capture_loop.h"
#include "daemon/configuration.h"
#include "daemon/control_server.h"
#include "daemon/controller.h"
#include "daemon/housekeeper.h"
#include "daemon/log.h"
#include "daemon/map_keeper.h"
#include "daemon/map_worker.h"
#include "daemon/publisher.h"
#include "daemon/realtime.h"
#include "daemon/recorder.h"
#include "daemon/recorder_setup.h"
#include "daemon/reload_signal.h"
#include "daemon/service_manager.h"
#include "daemon/slam_errands.h"
#include "daemon/slam_loop.h"
#include "daemon/stop_signal.h"
#include "daemon/triple_buffer.h"
#include "slam/slam.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

enum ExitCode { kDone = 0, kFault = 1, kBadInput = 2 };

// A thread with a name that top and gdb show. priority: 0 for none of its own.
template <typename Run>
std::thread startThread(const char* name, int priority, const Log& log, Run run) {
  std::thread thread(std::move(run));
  pthread_setname_np(thread.native_handle(), name);
  if (priority > 0) {
    if (const Status s = scheduleRealTime(thread, name, priority); !s) {
      log.warning(s.error().message);
    }
  }
  return thread;
}

// A camera whose frames are its driver's buffers needs some of them itself: one to fill and one to
// follow, while the SLAM loop works on a third.
std::size_t queueDepth(const Configuration& configuration) {
  constexpr int kOfTheCamera = 2;
  int depth = configuration.queue.depth;
  if (capture::isCamera(configuration.camera.source)) {
    depth = std::min(depth, configuration.camera.device.buffers - kOfTheCamera);
  }
  return static_cast<std::size_t>(std::max(depth, 1));
}

// Where systemd made a runtime directory for this service, the socket is in there.
fs::path controlSocket(const Configuration& configuration) {
  if (!configuration.control.socket.empty()) return configuration.control.socket;
  const char* directory = std::getenv("RUNTIME_DIRECTORY");  // NOLINT(concurrency-mt-unsafe)
  if (directory == nullptr || *directory == '\0') return {};
  const std::string_view all = directory;  // with colons between several
  return fs::path(all.substr(0, all.find(':'))) / "control.sock";
}

// Null where nobody wants a socket.
Result<std::unique_ptr<ControlServer>> openControl(const Configuration& configuration) {
  const fs::path socket = controlSocket(configuration);
  if (socket.empty()) return std::unique_ptr<ControlServer>();
  return ControlServer::open(socket);
}

// recorder, control: may be null.
int runDaemon(const Configuration& configuration, const fs::path& configuration_file,
              const ReloadSignal& reload_signal, const CameraSetup& camera, StartMap start,
              Recorder* recorder, ControlServer* control, Log& log) {
  StopSignal stop;       // first: threads inherit what it blocks
  cv::setNumThreads(1);  // the SLAM loop is one thread, and it does not wait for others
  CameraStatus camera_status;
  FrameQueue frames(queueDepth(configuration));
  SlamErrands errands(frames);
  auto slam = std::make_unique<slam::Slam>(slam::CameraModel(camera.calibration),
                                           *slam::Dictionary::byName(configuration.slam.dictionary),
                                           start.options, std::move(start.map));
  for (const std::string& warning : start.warnings) log.warning(warning);
  for (const std::string& note : start.notes) log.info(note);
  SlamOutput output;
  TripleBuffer<health_t> health;
  const ServiceManager service{};

  CaptureLoop capture_loop(camera.opener, frames, camera_status, log);
  SlamLoop slam_loop(std::move(slam), frames, camera_status, errands, output);
  Publisher publisher(configuration.publish, configuration.body, configuration.slam.dictionary,
                      output, camera_status, frames, health, log);
  Housekeeper housekeeper(frames, output, health, service, log,
                          {.watchdog_ns = ServiceManager::watchdogNs()});
  MapWorker maps(configuration.slam, camera.calibration, errands, output, log);
  Controller controller({.log = log,
                         .publisher = publisher,
                         .maps = maps,
                         .slam = output,
                         .service = service,
                         .recorder = recorder},
                        configuration, configuration_file);

  publisher.addCounters([&](const CounterSink& sink) { maps.tellCounters(sink); });
  publisher.addCounters([&](const CounterSink& sink) { controller.tellCounters(sink); });
  housekeeper.setTap([&](const health_t& message) { controller.setHealth(message); });
  housekeeper.watch(reload_signal.fd(), [&] {
    if (reload_signal.take()) controller.reloadBySignal();
  });
  if (control != nullptr) {
    control->setHandler(
        [&](auto client, const auto& line) { return controller.handle(client, line); });
    housekeeper.watch(control->fd(), [&] { control->serve(monotonicNs()); });
    housekeeper.watch(controller.answersFd(), [&] { controller.deliverAnswers(*control); });
    publisher.addCounters([&](const CounterSink& sink) { control->tellCounters(sink); });
  }
  if (recorder != nullptr) {
    capture_loop.setTap([&](const capture::Frame& frame) { recorder->addFrame(frame); });
    publisher.setTap([&](auto... message) { recorder->addMessage(message...); });
    publisher.addCounters([&](const CounterSink& sink) { recorder->tellCounters(sink); });
  }

  const Configuration::RealTime& realtime = configuration.realtime;
  if (realtime.lock_memory) {
    if (const Status locked = lockMemory(); !locked) log.warning(locked.error().message);
  }
  std::thread publisher_thread = startThread("wm-publisher", realtime.publisher_priority, log, [&] {
    publisher.run();
    stop.finish();
  });
  std::thread slam_thread =
      startThread("wm-slam", realtime.slam_priority, log, [&] { slam_loop.run(); });
  std::thread capture_thread =
      startThread("wm-capture", realtime.capture_priority, log, [&] { capture_loop.run(); });

  std::thread recorder_thread;
  if (recorder != nullptr) {
    recorder_thread = startThread("wm-recorder", 0, log, [&] { recorder->run(); });
  }
  std::thread map_thread = startThread("wm-maps", 0, log, [&] {
    giveWay();
    maps.run();
  });
  std::thread housekeeping_thread =
      startThread("wm-housekeeping", 0, log, [&] { housekeeper.run(); });
  service.ready();

  stop.wait();
  service.stopping();
  // Opening a source cannot be interrupted, and nothing has begun that would need an end.
  if (camera_status.firstOpening()) std::_Exit(kDone);
  capture_loop.requestStop();
  capture_thread.join();
  slam_thread.join();
  publisher_thread.join();
  if (recorder != nullptr) {
    recorder->requestStop();
    recorder_thread.join();
  }
  maps.requestStop();
  map_thread.join();
  // Meanwhile housekeeping goes on: an optimisation of everything may take longer than the watchdog
  // waits.
  const Result<std::string> saved = maps.saveAtEnd(slam_loop.slam());
  housekeeper.requestStop();
  housekeeping_thread.join();

  if (!saved) {
    log.error(saved.error().message);
  } else if (!saved->empty()) {
    log.info(*saved);
  }
  if (capture_loop.failure()) {
    log.error(capture_loop.failure()->message);
    return kBadInput;
  }
  const slam::Counters counters = slam_loop.counters();
  log.info("stopped after " + std::to_string(counters.frames) + " frames, " +
           std::to_string(counters.localized) + " of them localised");
  return saved ? kDone : kFault;
}

int run(const std::string& configuration_file, bool check_only) {
  const ReloadSignal reload_signal;  // from the beginning: it must not end a daemon that starts
  const bool for_journal = Log::journalListens();
  const Result<Configuration> configuration = readConfiguration(configuration_file);
  if (!configuration) {
    Log(LogLevel::kError, for_journal).error(configuration.error().message);
    return kBadInput;
  }
  Log log(configuration->log.level, for_journal);
  const Result<CameraSetup> camera = prepareCamera(*configuration);
  if (!camera) {
    log.error(camera.error().message);
    return kBadInput;
  }
  if (!camera->calibration_change.empty()) {
    log.info(configuration->camera.calibration.string() + ": " + camera->calibration_change);
  }
  Result<StartMap> start = readStartMap(configuration->slam, camera->calibration);
  if (!start) {
    log.error(start.error().message);
    return kBadInput;
  }
  if (check_only) return kDone;
  const Result<std::unique_ptr<Recorder>> recorder =
      makeRecorder(*configuration, configuration_file, camera->calibration, log);
  if (!recorder) {
    log.error(recorder.error().message);
    return kBadInput;
  }
  const Result<std::unique_ptr<ControlServer>> control = openControl(*configuration);
  if (!control) {
    log.error(control.error().message);
    return kBadInput;
  }
  return runDaemon(*configuration, configuration_file, reload_signal, *camera,
                   std::move(start).value(), recorder->get(), control->get(), log);
}

}  // namespace
}  // namespace waymark::daemon

int main(int argc, char** argv) {
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
