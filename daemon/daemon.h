// The parts of waymarkd, and the wiring between them:
//
//   capture thread --> [newest wins] --> SLAM thread --> [records, map] --> publisher thread
//        |                                  ^    ^                             |    |    |
//        |                             wakes   [requests]             [health] v    v    |
//        |                                  |    '--- map thread               |   LCM   |
//        |                                  '-------- housekeeping thread <----'         |
//        |                                              ^      ^                         |
//        |                              control socket -'      '- SIGHUP                 |
//        '--- [frames] ------------> recorder thread <------------- [messages] ----------'
//
//   SLAM thread <--> [one image, what was found in it] <--> relocalizer thread
//        '---> [one image, while somebody asks] ---> preview thread --> LCM
//
// The main thread only waits. A stop travels the same way as a frame: capture closes its queue, the
// SLAM loop empties it, the publisher sends what is left, the recorder writes it down, the map is
// saved, and housekeeping tells what came of it.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <thread>

#include "base/result.h"
#include "daemon/configuration.h"
#include "daemon/control/control_server.h"
#include "daemon/control/controller.h"
#include "daemon/control/reload_signal.h"
#include "daemon/control/stop_signal.h"
#include "daemon/frames/camera_setup.h"
#include "daemon/frames/camera_status.h"
#include "daemon/frames/capture_loop.h"
#include "daemon/frames/slam_loop.h"
#include "daemon/frames/slam_requests.h"
#include "daemon/frames/triple_buffer.h"
#include "daemon/maps/map_keeper.h"
#include "daemon/maps/map_worker.h"
#include "daemon/natural/natural_setup.h"
#include "daemon/natural/relocalizer_link.h"
#include "daemon/natural/relocalizer_loop.h"
#include "daemon/preview/preview_link.h"
#include "daemon/preview/preview_loop.h"
#include "daemon/publish/publisher.h"
#include "daemon/record/recorder.h"
#include "daemon/system/housekeeper.h"
#include "daemon/system/log.h"
#include "daemon/system/service_manager.h"

namespace waymark::daemon {

// What is checked before anything starts. Whatever is wrong with it is an error here.
struct DaemonParts {
  // Before all that others can see of a daemon, so that it ends as it should from then on; and
  // before its threads, which inherit what it blocks.
  StopSignal stop;
  std::filesystem::path configuration_file;
  Configuration configuration;
  CameraSetup camera;
  StartMap start;
  NaturalSetup natural;
  std::unique_ptr<Recorder> recorder;      // null: nothing is recorded
  std::unique_ptr<ControlServer> control;  // null: there is no control socket
};

// Who looks for natural markers, and how frames come there.
struct Relocalizer {
  Relocalizer(std::vector<slam::PosedNaturalMarker> pictures, const slam::CameraModel& camera,
              double core_share);

  RelocalizerLink link;
  RelocalizerLoop loop;
};

class Daemon {
 public:
  // Before it, `reload_signal` has blocked SIGHUP.
  Daemon(DaemonParts parts, const ReloadSignal& reload_signal, Log& log);

  // Runs until a signal, or the end of a recording. The error says why the recording could not be
  // read to its end, or the map not be saved.
  struct Failure {
    Error error;
    bool input_is_bad = false;  // else it is the daemon that failed
  };
  [[nodiscard]] std::optional<Failure> run();

 private:
  void wireHousekeeping();
  void wireRecorder();
  void wireRelocalizer();
  void wireCounters();
  void startThreads();
  [[nodiscard]] std::optional<Failure> stopThreads();
  void reportRejected(const Error& error);
  [[nodiscard]] std::thread start(const char* name, const ThreadOptions& options,
                                  std::function<void()> run);

  DaemonParts parts_;
  Log& log_;
  const ReloadSignal& reload_signal_;

  CameraStatus camera_status_;
  FrameQueue frames_;
  SlamRequests requests_;
  SlamOutput output_;
  TripleBuffer<health_t> health_;
  const ServiceManager service_{};
  std::atomic<std::uint64_t> rejections_{0};  // of what [realtime] asks for

  CaptureLoop capture_loop_;
  SlamLoop slam_loop_;
  Publisher publisher_;
  Housekeeper housekeeper_;
  MapWorker maps_;
  PreviewLink preview_link_;
  PreviewLoop preview_;
  Controller controller_;
  std::unique_ptr<Relocalizer> relocalizer_;  // null: there are no natural markers

  std::thread capture_thread_;
  std::thread slam_thread_;
  std::thread publisher_thread_;
  std::thread recorder_thread_;
  std::thread map_thread_;
  std::thread relocalizer_thread_;
  std::thread preview_thread_;
  std::thread housekeeping_thread_;
};

}  // namespace waymark::daemon
