// The thread for what takes long with maps: optimizing and writing them, reading others. The SLAM
// loop only gives it a copy of the map, or takes a whole SLAM from it.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/result.h"
#include "daemon/frames/slam_loop.h"
#include "daemon/frames/slam_requests.h"
#include "daemon/health/counter_source.h"
#include "daemon/maps/map_keeper.h"
#include "daemon/system/log.h"
#include "io/settings/slam_settings.h"
#include "slam/geometry/camera_model.h"

namespace waymark::daemon {

class MapWorker {
 public:
  struct Report {
    std::string last_save;      // what became of it; empty before the first
    std::int64_t saved_ns = 0;  // monotonic time of the last save that succeeded; 0: none did
    bool changed = false;       // since then
  };

  struct Options {
    // That wait; who wants one more is refused. As many as there are places for clients.
    std::size_t max_jobs = 16;
  };

  MapWorker(io::SlamSettings settings, const slam::Calibration& camera, SlamRequests& requests,
            const SlamOutput& output, const Log& log, const Options& options);
  MapWorker(io::SlamSettings settings, const slam::Calibration& camera, SlamRequests& requests,
            const SlamOutput& output, const Log& log)
      : MapWorker(std::move(settings), camera, requests, output, log, Options{}) {}

  // Told what came of a job, one line, on the worker's thread.
  using Done = std::function<void(const Result<std::string>&)>;
  // Who wants it, so that it can be forgotten.
  using Owner = std::optional<std::uint64_t>;
  // Any thread; one after the other. What fails leaves everything as it was.
  void save(Done done, Owner owner = {}) { submit({Job::kSave, {}, std::move(done), owner}); }
  // Goes on with the map in the file; an empty name means that of the configuration. The map that
  // was is kept as replacedOf() slam.map_out.
  void load(std::filesystem::path file, Done done, Owner owner = {}) {
    submit({Job::kLoad, std::move(file), std::move(done), owner});
  }
  // Begins a new map; the one that was is kept likewise.
  void reset(Done done, Owner owner = {}) { submit({Job::kReset, {}, std::move(done), owner}); }
  // The lens in use and how well it is known, as the text of a calibration file.
  void calibration(Done done, Owner owner = {}) {
    submit({Job::kCalibration, {}, std::move(done), owner});
  }
  // Any thread: jobs of this owner that wait are not done, and nobody is told.
  void forget(std::uint64_t owner);

  // Before run(): slam.map_out could not be written when the daemon started.
  void noteNotWritable(const std::string& reason);

  // Any thread. 0: only when asked.
  void setSaveInterval(int seconds);
  [[nodiscard]] int saveInterval() const;
  [[nodiscard]] Report report() const;
  // Names begin with "map.".
  void reportCounters(const CounterSink& sink) const;

  // The thread's body: returns after requestStop(), when the job under way is done.
  void run();
  void requestStop();
  // The last save, in the caller's thread, once the SLAM loop and this one's have ended: of what
  // has changed since the one before. Empty when there is nothing to say.
  [[nodiscard]] Result<std::string> saveAtEnd(slam::Slam& slam);

 private:
  enum class Job { kSave, kLoad, kReset, kCalibration };
  struct Request {
    Job job = Job::kSave;
    std::filesystem::path file;
    Done done;
    Owner owner;
  };
  using Clock = std::chrono::steady_clock;

  void submit(Request request);
  [[nodiscard]] std::optional<Request> next();
  void saveByItself();
  [[nodiscard]] Result<std::string> perform(const Request& request);
  [[nodiscard]] Result<std::string> saveNow();
  [[nodiscard]] Result<std::string> saveCopy(std::vector<slam::Map> pieces, double readout_s,
                                             const slam::Calibration& camera);
  // What surveyors and floor plans say, and the map does not bear out: a warning each, once. Takes
  // the marginals of all of the map.
  void noteContradictions(const slam::Slam& slam);
  // What has been learned of the lens, and how well, is the camera's, not a map's. As it was given
  // where nothing has; empty where the SLAM has come to its end.
  [[nodiscard]] std::optional<slam::Calibration> cameraInUse();
  // With a lens that is known: as given or as learned.
  [[nodiscard]] slam::Options withLens(slam::Options options,
                                       const slam::Calibration& camera) const;
  [[nodiscard]] Result<std::string> loadNow(const std::filesystem::path& asked);
  [[nodiscard]] Result<std::string> resetNow();
  [[nodiscard]] Result<std::string> calibrationNow();
  [[nodiscard]] Result<std::string> goOnWith(StartMap start);
  [[nodiscard]] std::string keepReplaced(const slam::Slam& before);
  void noteSave(const Result<std::string>& outcome, std::uint64_t revision);
  // Since the last save, or the start. Precondition: the lock is held, or there is one thread.
  [[nodiscard]] bool changed() const;

  const io::SlamSettings settings_;
  const slam::Calibration camera_;
  SlamRequests& slam_requests_;
  const SlamOutput& output_;
  const Log& log_;
  const Options options_;

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<Request> requests_;
  bool stop_ = false;
  int interval_s_;
  Clock::time_point last_attempt_;
  std::string last_save_;
  std::int64_t saved_ns_ = 0;
  std::uint64_t saved_revision_ = 0;
  std::set<std::string> told_contradictions_;

  std::atomic<std::uint64_t> saves_{0};
  std::atomic<std::uint64_t> save_failures_{0};
  std::atomic<std::uint64_t> loads_{0};
  std::atomic<std::uint64_t> load_failures_{0};
  std::atomic<std::uint64_t> resets_{0};
  std::atomic<std::uint64_t> rejected_jobs_{0};
};

}  // namespace waymark::daemon
