// What the control socket and SIGHUP ask for, done: the daemon's parts behind one object. Lives on
// the housekeeping thread, and never waits: what takes long is answered later.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/result.h"
#include "base/unique_fd.h"
#include "daemon/configuration.h"
#include "daemon/control/control_request.h"
#include "daemon/control/control_server.h"
#include "daemon/frames/slam_loop.h"
#include "daemon/health/counter_source.h"
#include "daemon/maps/map_worker.h"
#include "daemon/preview/preview_link.h"
#include "daemon/publish/publisher.h"
#include "daemon/record/recorder.h"
#include "daemon/system/log.h"
#include "daemon/system/service_manager.h"
#include "io/settings/settings_file.h"
#include "io/text/json_node.h"
#include <waymark/health_t.hpp>

namespace waymark::daemon {

class Controller {
 public:
  // What there is to control.
  struct Parts {
    Log& log;
    Publisher& publisher;
    MapWorker& maps;
    const SlamOutput& slam;
    const ServiceManager& service;
    PreviewLink& preview;
    Recorder* recorder = nullptr;  // may be null
  };

  // `configuration` is the one that the daemon runs with, read from `file`.
  Controller(const Parts& parts, const Configuration& configuration, std::filesystem::path file);

  // One request of a client of the control socket.
  [[nodiscard]] ControlServer::Answer handle(ControlServer::ClientId client,
                                             const std::string& line);
  // Readable when there are answers that were left open; give them to the server then.
  [[nodiscard]] int answersFd() const { return answers_ready_.get(); }
  void deliverAnswers(ControlServer& server);

  // SIGHUP: reads the configuration again, and tells the log and the service manager.
  void reloadBySignal();
  // The latest health, for `status`.
  void setHealth(const health_t& health) { health_ = health; }

  // Any thread. Names begin with "configuration.".
  void reportCounters(const CounterSink& sink) const;

 private:
  struct Reloaded {
    std::vector<std::string> applied;        // keys that changed and hold from now on
    std::vector<std::string> needs_restart;  // keys that changed and do not
  };

  // A reply, or nothing when it comes later.
  using Reply = std::optional<io::Json>;
  Reply execute(const StatusRequest& request, ControlServer::ClientId client);
  Reply execute(const SaveMapRequest& request, ControlServer::ClientId client);
  Reply execute(const LoadMapRequest& request, ControlServer::ClientId client);
  Reply execute(const ResetRequest& request, ControlServer::ClientId client);
  Reply execute(const CalibrationRequest& request, ControlServer::ClientId client);
  Reply execute(const RecordRequest& request, ControlServer::ClientId client);
  Reply execute(const PreviewRequest& request, ControlServer::ClientId client);
  Reply execute(const ReloadRequest& request, ControlServer::ClientId client);
  Reply execute(const SetLogLevelRequest& request, ControlServer::ClientId client);

  [[nodiscard]] Result<Reloaded> reload();
  [[nodiscard]] MapWorker::Done answerLater(ControlServer::ClientId client);
  [[nodiscard]] io::Json mapStatus() const;
  [[nodiscard]] io::Json recorderStatus() const;

  const Parts parts_;
  const std::filesystem::path file_;
  const std::filesystem::path map_file_;
  const io::SettingTexts started_with_;
  health_t health_{};

  const UniqueFd answers_ready_;  // an eventfd
  std::mutex answers_mutex_;
  std::vector<std::pair<ControlServer::ClientId, std::string>> answers_;

  std::atomic<std::uint64_t> reloads_{0};
  std::atomic<std::uint64_t> reload_failures_{0};
};

}  // namespace waymark::daemon
