#include "daemon/daemon.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <string>
#include <utility>

#include "base/clock.h"
#include "base/freed_memory.h"
#include "capture/open_source.h"
#include "daemon/system/realtime.h"
#include "slam/slam.h"

namespace waymark::daemon {
namespace {

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

std::vector<int> idsOf(const std::vector<slam::PosedNaturalMarker>& pictures) {
  std::vector<int> ids;
  for (const slam::PosedNaturalMarker& picture : pictures) ids.push_back(picture.id);
  return ids;
}

}  // namespace

Relocalizer::Relocalizer(std::vector<slam::PosedNaturalMarker> pictures,
                         const slam::CameraModel& camera, double core_share)
    : link(idsOf(pictures), camera.calibration().width, camera.calibration().height),
      loop(std::move(pictures), link, {.core_share = core_share, .relocalizer = {}}) {}

Daemon::Daemon(DaemonParts parts, const ReloadSignal& reload_signal, Log& log)
    : parts_(std::move(parts)),
      log_(log),
      reload_signal_(reload_signal),
      frames_(queueDepth(parts_.configuration)),
      requests_(frames_),
      capture_loop_(parts_.camera.opener, frames_, camera_status_, log_),
      slam_loop_(
          makeSlam(parts_.configuration.slam, parts_.start.lens.value_or(parts_.camera.calibration),
                   parts_.start.options, std::move(parts_.start.map),
                   std::move(parts_.start.others)),
          frames_, camera_status_, requests_, output_),
      publisher_(parts_.configuration.publish, parts_.configuration.body,
                 parts_.configuration.slam.dictionary, output_, camera_status_, frames_, health_,
                 log_),
      housekeeper_(frames_, output_, health_, service_, log_,
                   {.watchdog_ns = ServiceManager::watchdogNs()}),
      maps_(parts_.configuration.slam, parts_.camera.calibration, requests_, output_, log_),
      preview_link_(parts_.camera.calibration.width, parts_.camera.calibration.height),
      preview_(preview_link_, parts_.configuration.publish.url,
               parts_.configuration.publish.channel_prefix + "PREVIEW", log_),
      controller_({.log = log_,
                   .publisher = publisher_,
                   .maps = maps_,
                   .slam = output_,
                   .service = service_,
                   .preview = preview_link_,
                   .recorder = parts_.recorder.get()},
                  parts_.configuration, parts_.configuration_file) {
  wireHousekeeping();
  wireRecorder();
  wireRelocalizer();
  slam_loop_.setPreview(&preview_link_);
  wireCounters();
}

void Daemon::wireHousekeeping() {
  housekeeper_.setTap([this](const health_t& message) { controller_.setHealth(message); });
  housekeeper_.watch(reload_signal_.fd(), [this] {
    if (reload_signal_.take()) controller_.reloadBySignal();
  });
  if (ControlServer* const control = parts_.control.get()) {
    control->setGoneHandler([this](auto client) { maps_.forget(client); });
    control->setHandler(
        [this](auto client, const auto& line) { return controller_.handle(client, line); });
    housekeeper_.watch(control->fd(), [control] { control->serve(monotonicNs()); });
    housekeeper_.watch(controller_.answersFd(),
                       [this, control] { controller_.deliverAnswers(*control); });
  }
}

void Daemon::wireRecorder() {
  Recorder* const recorder = parts_.recorder.get();
  if (recorder == nullptr) return;
  capture_loop_.setTap([recorder](const capture::Frame& frame) { recorder->addFrame(frame); });
  publisher_.setTap([recorder](auto... message) { recorder->addMessage(message...); });
}

void Daemon::wireRelocalizer() {
  std::vector<slam::PosedNaturalMarker>& pictures = parts_.natural.pictures;
  if (pictures.empty()) return;
  relocalizer_ = std::make_unique<Relocalizer>(std::move(pictures),
                                               slam::CameraModel(parts_.camera.calibration),
                                               parts_.configuration.relocalizer.core_share);
  slam_loop_.setRelocalizer(&relocalizer_->link);
  publisher_.setPrints(byId(parts_.configuration.slam.options.natural.prints));
}

void Daemon::wireCounters() {
  const auto add = [this](const auto* part) {
    if (part == nullptr) return;
    publisher_.addCounters([part](const CounterSink& sink) { part->reportCounters(sink); });
  };
  add(&maps_);
  add(&controller_);
  add(&preview_);
  add(parts_.control.get());
  add(parts_.recorder.get());
  if (relocalizer_) add(&relocalizer_->loop);
  publisher_.addCounters([this](const CounterSink& sink) {
    sink("realtime.refused", rejections_.load(std::memory_order_relaxed));
    sink("log.lost_lines", log_.lost());
  });
}

std::optional<Daemon::Failure> Daemon::run() {
  for (const std::string& warning : parts_.start.warnings) log_.warning(warning);
  for (const std::string& note : parts_.start.notes) log_.info(note);
  if (!parts_.start.not_writable.empty()) maps_.noteNotWritable(parts_.start.not_writable);
  startThreads();
  service_.ready();
  parts_.stop.wait();
  service_.stopping();
  // Opening a source cannot be interrupted, and nothing has begun that would need an end.
  if (camera_status_.firstOpening()) {
    log_.drain();
    std::_Exit(EXIT_SUCCESS);
  }
  return stopThreads();
}

std::thread Daemon::start(const char* name, const ThreadOptions& options,
                          std::function<void()> run) {
  return startThread(
      name, options, [this](const Error& error) { reportRejected(error); }, std::move(run));
}

// Any thread.
void Daemon::reportRejected(const Error& error) {
  log_.warning(error.message);
  rejections_.fetch_add(1, std::memory_order_relaxed);
}

void Daemon::startThreads() {
  const Configuration::RealTime& realtime = parts_.configuration.realtime;
  if (realtime.lock_memory) {
    keepFreedMemory();
    if (const Status locked = lockMemory(); !locked) reportRejected(locked.error());
  }
  publisher_thread_ = start("wm-publisher", realtime.publisher, [this] {
    publisher_.run();
    parts_.stop.finish();
  });
  slam_thread_ = start("wm-slam", realtime.slam, [this] { slam_loop_.run(); });
  capture_thread_ = start("wm-capture", realtime.capture, [this] { capture_loop_.run(); });
  if (parts_.recorder) {
    recorder_thread_ = start("wm-recorder", realtime.recorder, [this] { parts_.recorder->run(); });
  }
  map_thread_ = start("wm-maps", {}, [this] {
    if (const Status lowered = lowerPriority("wm-maps"); !lowered) reportRejected(lowered.error());
    maps_.run();
  });
  if (relocalizer_) {
    relocalizer_thread_ = start("wm-natural", {}, [this] {
      if (const Status s = lowerPriority("wm-natural"); !s) reportRejected(s.error());
      relocalizer_->loop.run();
    });
  }
  preview_thread_ = start("wm-preview", {}, [this] {
    if (const Status s = lowerPriority("wm-preview"); !s) reportRejected(s.error());
    preview_.run();
  });
  housekeeping_thread_ = start("wm-housekeeping", {}, [this] { housekeeper_.run(); });
}

std::optional<Daemon::Failure> Daemon::stopThreads() {
  capture_loop_.requestStop();
  capture_thread_.join();
  slam_thread_.join();
  if (relocalizer_) {
    relocalizer_->link.requestStop();
    relocalizer_thread_.join();
  }
  preview_link_.requestStop();
  preview_thread_.join();
  publisher_thread_.join();
  if (parts_.recorder) {
    parts_.recorder->requestStop();
    recorder_thread_.join();
  }
  maps_.requestStop();
  map_thread_.join();
  // Meanwhile housekeeping goes on: an optimization of everything may take longer than the watchdog
  // waits.
  const Result<std::string> saved = maps_.saveAtEnd(slam_loop_.slam());
  housekeeper_.requestStop();
  housekeeping_thread_.join();

  if (saved && !saved->empty()) log_.info(*saved);
  if (const auto failure = capture_loop_.failure()) {
    if (!saved) log_.error(saved.error().message);
    return Failure{*failure, /*input_is_bad=*/true};
  }
  const slam::Counters counters = slam_loop_.counters();
  log_.info("stopped after " + std::to_string(counters.frames) + " frames, " +
            std::to_string(counters.localized) + " of them localized");
  if (!saved) return Failure{saved.error()};
  return std::nullopt;
}

}  // namespace waymark::daemon
