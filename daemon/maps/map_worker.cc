#include "daemon/maps/map_worker.h"

#include <chrono>
#include <system_error>
#include <utility>

#include "base/clock.h"
#include "io/calibrations/calibration_file.h"
#include "io/maps/map_file.h"
#include "io/text/text_file.h"
#include "slam/covariance/constraint_check.h"
#include "slam/final_map.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

const Error kStopping{"the daemon is stopping"};

}  // namespace

MapWorker::MapWorker(io::SlamSettings settings, const slam::Calibration& camera,
                     SlamRequests& requests, const SlamOutput& output, const Log& log,
                     const Options& options)
    : settings_(std::move(settings)),
      camera_(camera),
      slam_requests_(requests),
      output_(output),
      log_(log),
      options_(options),
      interval_s_(settings_.map.save_interval_s),
      last_attempt_(Clock::now()) {}

void MapWorker::submit(Request request) {
  Error reason = kStopping;
  {
    const std::lock_guard lock(mutex_);
    if (!stop_ && requests_.size() < options_.max_jobs) {
      requests_.push_back(std::move(request));
      wake_.notify_one();
      return;
    }
    if (!stop_) {
      reason = {std::to_string(requests_.size()) + " others wait already; try again later"};
      rejected_jobs_.fetch_add(1, std::memory_order_relaxed);
    }
  }
  request.done(reason);
}

void MapWorker::forget(std::uint64_t owner) {
  const std::lock_guard lock(mutex_);
  std::erase_if(requests_, [&](const Request& request) { return request.owner == owner; });
}

void MapWorker::noteNotWritable(const std::string& reason) {
  save_failures_.fetch_add(1, std::memory_order_relaxed);
  const std::lock_guard lock(mutex_);
  last_save_ = reason;
}

void MapWorker::setSaveInterval(int seconds) {
  const std::lock_guard lock(mutex_);
  interval_s_ = seconds;
  wake_.notify_one();
}

int MapWorker::saveInterval() const {
  const std::lock_guard lock(mutex_);
  return interval_s_;
}

void MapWorker::run() {
  while (std::optional<Request> request = next()) {
    if (request->done) {
      request->done(perform(*request));
    } else {
      saveByItself();
    }
  }
}

void MapWorker::requestStop() {
  std::deque<Request> left;
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
    left.swap(requests_);
    wake_.notify_one();
  }
  for (const Request& request : left) request.done(kStopping);
}

// The next request, or one that nobody made when it is time to save; empty at the end.
std::optional<MapWorker::Request> MapWorker::next() {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    if (!requests_.empty()) {
      Request request = std::move(requests_.front());
      requests_.pop_front();
      return request;
    }
    const bool by_itself = interval_s_ > 0 && !settings_.map.out.empty();
    const auto due = last_attempt_ + std::chrono::seconds(interval_s_);
    if (!by_itself) {
      wake_.wait(lock);
    } else if (Clock::now() >= due) {
      last_attempt_ = Clock::now();
      const bool has_map = output_.map_markers.load(std::memory_order_relaxed) > 0 ||
                           output_.map_natural_markers.load(std::memory_order_relaxed) > 0;
      if (has_map && changed()) return Request{};
    } else {
      wake_.wait_until(lock, due);
    }
  }
  return std::nullopt;
}

void MapWorker::saveByItself() {
  const Result<std::string> saved = saveNow();
  if (!saved) {
    log_.warning(saved.error().message + "; trying again later");
  } else {
    log_.debug(*saved);
  }
}

Result<std::string> MapWorker::perform(const Request& request) {
  switch (request.job) {
    case Job::kSave:
      return saveNow();
    case Job::kLoad:
      return loadNow(request.file);
    case Job::kReset:
      return resetNow();
    case Job::kCalibration:
      return calibrationNow();
  }
  return kStopping;
}

Result<std::string> MapWorker::saveNow() {
  if (settings_.map.localize_only) return Error{"with slam.localize_only no map is written"};
  if (settings_.map.out.empty()) return Error{"slam.map_out is not configured"};
  std::vector<slam::Map> pieces;
  slam::Calibration camera;
  double readout_s = 0.0;
  std::uint64_t revision = 0;
  std::int64_t copying_ns = 0;
  const bool copied = slam_requests_.run([&](const std::unique_ptr<slam::Slam>& slam) {
    const std::int64_t begin_ns = monotonicNs();
    pieces = slam::piecesThroughOneLens(*slam);
    copying_ns = monotonicNs() - begin_ns;
    camera = slam->lens().calibrationOf(slam->camera());
    readout_s = slam->readout_s();
    revision = output_.map_revision.load(std::memory_order_relaxed);
  });
  if (!copied) return kStopping;
  log_.debug("copying the map took the SLAM loop " + std::to_string(copying_ns / 1000) + " us");
  if (pieces.front().empty()) return Error{"there is no map to save"};
  Result<std::string> saved = saveCopy(std::move(pieces), readout_s, camera);
  noteSave(saved, revision);
  return saved;
}

// Optimized as at the end of a recording, but without frames, in a SLAM that will see none.
Result<std::string> MapWorker::saveCopy(std::vector<slam::Map> pieces, double readout_s,
                                        const slam::Calibration& camera) {
  slam::Options options = withLens(settings_.options, camera);
  options.shutter.learned_s = readout_s;
  slam::Map first = std::move(pieces.front());
  pieces.erase(pieces.begin());
  const auto slam = makeSlam(settings_, camera, options, std::move(first), std::move(pieces));
  slam::makeFinalMap({}, {}, slam.get());
  noteContradictions(*slam);
  return writeMap(settings_, *slam);
}

void MapWorker::noteContradictions(const slam::Slam& slam) {
  const slam::MarkerOptions& markers = settings_.options.markers;
  auto found = contradictions(slam.pieces(), markers);
  std::erase_if(found, [&](const slam::ConstraintResidual& residual) {
    return !told_contradictions_.insert(constraintText({.source = residual.source}, markers))
                .second;
  });
  for (const std::string& line : contradictionLines(found, markers)) log_.warning(line);
}

std::optional<slam::Calibration> MapWorker::cameraInUse() {
  slam::Calibration camera;
  const bool told = slam_requests_.run([&](const std::unique_ptr<slam::Slam>& slam) {
    camera = slam->lens().calibrationOf(slam->camera());
  });
  return told ? std::optional(camera) : std::nullopt;
}

Result<std::string> MapWorker::calibrationNow() {
  const std::optional<slam::Calibration> camera = cameraInUse();
  return camera ? Result<std::string>(io::formatCalibration(*camera)) : kStopping;
}

slam::Options MapWorker::withLens(slam::Options options, const slam::Calibration& camera) const {
  if (camera != camera_) options.lens.given = true;
  return options;
}

Result<std::string> MapWorker::loadNow(const fs::path& asked) {
  const io::MapSettings& map = settings_.map;
  const fs::path& file = !asked.empty() ? asked : !map.in.empty() ? map.in : map.out;
  Result<std::string> loaded = Error{"no file is named, and none is configured"};
  std::error_code error;
  if (fs::exists(file, error) && !fs::is_regular_file(file, error)) {
    loaded = Error{file.string() + ": is not a file"};
  } else if (!file.empty()) {
    const std::optional<slam::Calibration> camera = cameraInUse();
    if (!camera) return kStopping;
    Result<StartMap> start = readOtherMap(file, settings_, *camera);
    loaded = start ? goOnWith(std::move(start).value()) : Result<std::string>(start.error());
  }
  (loaded ? loads_ : load_failures_).fetch_add(1, std::memory_order_relaxed);
  return loaded;
}

Result<std::string> MapWorker::resetNow() {
  if (settings_.map.localize_only) return Error{"with slam.localize_only the map stays as it is"};
  StartMap nothing;
  nothing.options = settings_.options;
  nothing.notes.emplace_back("beginning a new map");
  Result<std::string> reset = goOnWith(std::move(nothing));
  if (reset) resets_.fetch_add(1, std::memory_order_relaxed);
  return reset;
}

// The SLAM that was is destroyed here, too.
Result<std::string> MapWorker::goOnWith(StartMap start) {
  const std::optional<slam::Calibration> camera = cameraInUse();
  if (!camera) return kStopping;
  const slam::Calibration& lens = start.lens ? *start.lens : *camera;
  auto slam = makeSlam(settings_, lens, withLens(start.options, lens), std::move(start.map),
                       std::move(start.others));
  if (!slam_requests_.run([&](std::unique_ptr<slam::Slam>& running) { running.swap(slam); })) {
    return kStopping;
  }
  for (const std::string& warning : start.warnings) log_.warning(warning);
  for (const std::string& note : start.notes) log_.info(note);
  return start.notes.back() + keepReplaced(*slam);
}

// One generation. The file of the map itself stays as it is, and the two saves after this one would
// take it and its previous one away. As it was live: optimizing it would take long, and loading it
// does not need that. Returns what to say of it.
std::string MapWorker::keepReplaced(const slam::Slam& before) {
  if (settings_.map.out.empty() || settings_.map.localize_only || before.map().empty()) return "";
  const fs::path file = replacedOf(settings_.map.out);
  const Status written = io::writeTextFile(file, mapText(before));
  if (written) return "; the one before is in " + file.string();
  log_.warning("the map before is not kept: " + written.error().message);
  save_failures_.fetch_add(1, std::memory_order_relaxed);
  return "; the one before is not kept: " + written.error().message;
}

void MapWorker::noteSave(const Result<std::string>& outcome, std::uint64_t revision) {
  (outcome ? saves_ : save_failures_).fetch_add(1, std::memory_order_relaxed);
  const std::lock_guard lock(mutex_);
  last_save_ = outcome ? *outcome : outcome.error().message;
  last_attempt_ = Clock::now();
  if (!outcome) return;
  saved_ns_ = monotonicNs();
  saved_revision_ = revision;
}

bool MapWorker::changed() const {
  return output_.map_revision.load(std::memory_order_relaxed) != saved_revision_;
}

Result<std::string> MapWorker::saveAtEnd(slam::Slam& slam) {
  const std::uint64_t revision = output_.map_revision.load(std::memory_order_relaxed);
  if (settings_.map.out.empty() || (saved_ns_ != 0 && !changed())) return std::string();
  Result<std::string> saved = saveMap(settings_, slam);
  noteContradictions(slam);
  noteSave(saved, revision);
  return saved;
}

MapWorker::Report MapWorker::report() const {
  const std::lock_guard lock(mutex_);
  return {last_save_, saved_ns_, changed()};
}

void MapWorker::reportCounters(const CounterSink& sink) const {
  sink("map.saves", saves_.load(std::memory_order_relaxed));
  sink("map.save_failures", save_failures_.load(std::memory_order_relaxed));
  sink("map.loads", loads_.load(std::memory_order_relaxed));
  sink("map.load_failures", load_failures_.load(std::memory_order_relaxed));
  sink("map.resets", resets_.load(std::memory_order_relaxed));
  sink("map.jobs_refused", rejected_jobs_.load(std::memory_order_relaxed));
}

}  // namespace waymark::daemon
