#include "tools/stage_timer.h"

#include <algorithm>
#include <numeric>
#include <span>

#include <nlohmann/json.hpp>

#include "base/clock.h"
#include "base/quantile.h"

namespace waymark::tools {
namespace {

nlohmann::ordered_json toJson(const std::vector<double>& times_ms) {
  const TimeSummary s = summarize(times_ms);
  return {{"mean", s.mean}, {"median", s.median}, {"p99", s.p99}, {"p999", s.p999}, {"max", s.max}};
}

}  // namespace

TimeSummary summarize(std::vector<double> times) {
  if (times.empty()) return {};
  std::sort(times.begin(), times.end());
  const std::span<const double> sorted(times);
  return {
      .mean = std::accumulate(times.begin(), times.end(), 0.0) / static_cast<double>(times.size()),
      .median = quantile(sorted, 500),
      .p99 = quantile(sorted, 990),
      .p999 = quantile(sorted, 999),
      .max = times.back()};
}

StageTimer::Reading StageTimer::now() {
  return {1e-6 * static_cast<double>(monotonicNs()), 1e-6 * static_cast<double>(threadCpuNs())};
}

void StageTimer::start(Watch& watch) { watch.started = now(); }

void StageTimer::stop(Watch& watch) {
  const Reading stopped = now();
  watch.frame.wall_ms += stopped.wall_ms - watch.started.wall_ms;
  watch.frame.cpu_ms += stopped.cpu_ms - watch.started.cpu_ms;
}

void StageTimer::store(Watch& watch) const {
  for (std::vector<double>* times_ms : {&watch.wall_ms, &watch.cpu_ms}) {
    if (times_ms->size() / 2 < max_frames_) continue;
    times_ms->erase(times_ms->begin(),
                    times_ms->begin() + static_cast<std::ptrdiff_t>(max_frames_));
  }
  watch.wall_ms.push_back(watch.frame.wall_ms);
  watch.cpu_ms.push_back(watch.frame.cpu_ms);
  watch.frame = {};
}

void StageTimer::beginFrame() { start(total_); }

void StageTimer::endFrame() {
  stop(total_);
  total_wall_ms_ += total_.frame.wall_ms;
  store(total_);
  for (Watch& stage : stages_) store(stage);
}

void StageTimer::begin(slam::Stage stage) { start(stages_[static_cast<std::size_t>(stage)]); }
void StageTimer::end(slam::Stage stage) { stop(stages_[static_cast<std::size_t>(stage)]); }

nlohmann::ordered_json StageTimer::json() const {
  nlohmann::ordered_json json;
  const auto add = [&json](const char* name, const Watch& watch) {
    json[name] = {{"wall_ms", toJson(watch.wall_ms)}, {"cpu_ms", toJson(watch.cpu_ms)}};
  };
  add("total", total_);
  for (std::size_t i = 0; i < stages_.size(); ++i) add(slam::kStages[i].name, stages_[i]);
  return json;
}

}  // namespace waymark::tools
