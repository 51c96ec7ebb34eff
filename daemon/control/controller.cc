#include "daemon/control/controller.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <variant>

#include <sys/eventfd.h>

#include "base/clock.h"
#include "daemon/health/health_json.h"
#include "io/settings/settings_file.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;
using io::Json;

// What a reload applies; all other keys need a restart.
constexpr std::string_view kLogLevel = "log.level";
constexpr std::string_view kDetections = "publish.detections";
constexpr std::string_view kSaveInterval = "slam.map_save_interval_s";

bool isLive(std::string_view key) {
  return key == kLogLevel || key == kDetections || key == kSaveInterval;
}

Json success() { return {{"ok", true}}; }

Json failure(const std::string& reason) { return {{"ok", false}, {"error", reason}}; }

Json outcome(const Result<std::string>& result) {
  if (!result) return failure(result.error().message);
  Json reply = success();
  reply["result"] = *result;
  return reply;
}

// One line. Names of files and devices need not be UTF-8; what is not is replaced.
std::string lineOf(const Json& reply) {
  return reply.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string listed(const std::vector<std::string>& keys) {
  std::string text;
  for (const std::string& key : keys) text += (text.empty() ? "" : ", ") + key;
  return text;
}

const char* recorderStateName(RecorderState state) {
  switch (state) {
    case RecorderState::kOff:
      return "off";
    case RecorderState::kRecording:
      return "recording";
    case RecorderState::kPaused:
      return "paused";
  }
  return "";
}

}  // namespace

Controller::Controller(const Parts& parts, const Configuration& configuration, fs::path file)
    : parts_(parts),
      file_(std::move(file)),
      map_file_(configuration.slam.map.out),
      started_with_(io::settingTexts(configuration.text)),
      answers_ready_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}

ControlServer::Answer Controller::handle(ControlServer::ClientId client, const std::string& line) {
  const Result<ControlRequest> request = parseControlRequest(line);
  if (!request) return {lineOf(failure(request.error().message)), true};
  const Reply reply =
      std::visit([&](const auto& wanted) { return execute(wanted, client); }, *request);
  if (!reply) return {};
  return {lineOf(*reply), false};
}

Controller::Reply Controller::execute(const StatusRequest& /*request*/,
                                      ControlServer::ClientId /*client*/) {
  Json reply = success();
  reply.update(healthJson(health_));
  reply["map"] = mapStatus();
  reply["recorder"] = recorderStatus();
  reply["log_level"] = nameOf(parts_.log.level());
  return reply;
}

Controller::Reply Controller::execute(const SaveMapRequest& /*request*/,
                                      ControlServer::ClientId client) {
  parts_.maps.save(answerLater(client), client);
  return {};
}

Controller::Reply Controller::execute(const LoadMapRequest& request,
                                      ControlServer::ClientId client) {
  parts_.maps.load(request.file, answerLater(client), client);
  return {};
}

Controller::Reply Controller::execute(const ResetRequest& /*request*/,
                                      ControlServer::ClientId client) {
  parts_.maps.reset(answerLater(client), client);
  return {};
}

Controller::Reply Controller::execute(const CalibrationRequest& /*request*/,
                                      ControlServer::ClientId client) {
  parts_.maps.calibration(answerLater(client), client);
  return {};
}

Controller::Reply Controller::execute(const RecordRequest& request,
                                      ControlServer::ClientId /*client*/) {
  if (parts_.recorder == nullptr) return failure("record.directory is not configured");
  if (request.start) {
    parts_.recorder->start();
  } else {
    parts_.recorder->stop();
  }
  return success();
}

Controller::Reply Controller::execute(const PreviewRequest& /*request*/,
                                      ControlServer::ClientId /*client*/) {
  parts_.preview.ask(monotonicNs());
  Json reply = success();
  reply["lease_s"] = 1e-9 * static_cast<double>(PreviewLink::kLease_ns);
  return reply;
}

Controller::Reply Controller::execute(const ReloadRequest& /*request*/,
                                      ControlServer::ClientId /*client*/) {
  const Result<Reloaded> reloaded = reload();
  if (!reloaded) return failure(reloaded.error().message);
  Json reply = success();
  reply["applied"] = reloaded->applied;
  reply["needs_restart"] = reloaded->needs_restart;
  return reply;
}

Controller::Reply Controller::execute(const SetLogLevelRequest& request,
                                      ControlServer::ClientId /*client*/) {
  parts_.log.setLevel(request.level);
  return success();
}

MapWorker::Done Controller::answerLater(ControlServer::ClientId client) {
  return [this, client](const Result<std::string>& result) {
    const std::lock_guard lock(answers_mutex_);
    answers_.emplace_back(client, lineOf(outcome(result)));
    ::eventfd_write(answers_ready_.get(), 1);
  };
}

void Controller::deliverAnswers(ControlServer& server) {
  eventfd_t ignored = 0;
  ::eventfd_read(answers_ready_.get(), &ignored);
  std::vector<std::pair<ControlServer::ClientId, std::string>> answers;
  {
    const std::lock_guard lock(answers_mutex_);
    answers.swap(answers_);
  }
  for (const auto& [client, line] : answers) server.answer(client, line, monotonicNs());
}

void Controller::reloadBySignal() {
  parts_.service.reloading();
  const Result<Reloaded> reloaded = reload();
  if (!reloaded) parts_.log.error("not reloaded: " + reloaded.error().message);
  parts_.service.reloaded();
}

// All or nothing: the file is checked as a whole before anything is applied.
Result<Controller::Reloaded> Controller::reload() {
  const Result<Configuration> fresh = readConfiguration(file_);
  if (!fresh) {
    reload_failures_.fetch_add(1, std::memory_order_relaxed);
    return fresh.error();
  }
  Reloaded keys;
  if (fresh->log.level != parts_.log.level()) {
    parts_.log.setLevel(fresh->log.level);
    keys.applied.emplace_back(kLogLevel);
  }
  if (fresh->publish.detections != parts_.publisher.detections()) {
    parts_.publisher.setDetections(fresh->publish.detections);
    keys.applied.emplace_back(kDetections);
  }
  if (fresh->slam.map.save_interval_s != parts_.maps.saveInterval()) {
    parts_.maps.setSaveInterval(fresh->slam.map.save_interval_s);
    keys.applied.emplace_back(kSaveInterval);
  }
  for (std::string& key : io::changedSettings(started_with_, io::settingTexts(fresh->text))) {
    if (!isLive(key)) keys.needs_restart.push_back(std::move(key));
  }
  reloads_.fetch_add(1, std::memory_order_relaxed);
  std::string told = file_.string() + ": read again";
  if (!keys.applied.empty()) told += "; applied: " + listed(keys.applied);
  if (!keys.needs_restart.empty()) told += "; need a restart: " + listed(keys.needs_restart);
  parts_.log.info(told);
  return keys;
}

Json Controller::mapStatus() const {
  const MapWorker::Report report = parts_.maps.report();
  Json json;
  json["markers"] = parts_.slam.map_markers.load(std::memory_order_relaxed);
  json["natural_markers"] = parts_.slam.map_natural_markers.load(std::memory_order_relaxed);
  json["keyframes"] = parts_.slam.map_keyframes.load(std::memory_order_relaxed);
  json["pieces"] = parts_.slam.map_pieces.load(std::memory_order_relaxed);
  json["file"] = map_file_.string();
  json["changed_since_save"] = report.changed;
  json["last_save"] = report.last_save;
  json["last_save_age_s"] = report.saved_ns == 0
                                ? Json()
                                : Json(1e-9 * static_cast<double>(monotonicNs() - report.saved_ns));
  return json;
}

Json Controller::recorderStatus() const {
  if (parts_.recorder == nullptr) return nullptr;
  const Recorder::Report report = parts_.recorder->report();
  return {
      {"state", recorderStateName(report.state)}, {"reason", report.reason}, {"file", report.file}};
}

void Controller::reportCounters(const CounterSink& sink) const {
  sink("configuration.reloads", reloads_.load(std::memory_order_relaxed));
  sink("configuration.reload_failures", reload_failures_.load(std::memory_order_relaxed));
}

}  // namespace waymark::daemon
