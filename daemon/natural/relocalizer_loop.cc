#include "daemon/natural/relocalizer_loop.h"

#include <chrono>
#include <cmath>
#include <cstddef>
#include <utility>

#include "base/clock.h"

namespace waymark::daemon {

RelocalizerLoop::RelocalizerLoop(std::vector<slam::PosedNaturalMarker> pictures,
                                 RelocalizerLink& link, const RelocalizerLoopOptions& options)
    : relocalizer_(std::move(pictures), options.relocalizer),
      link_(link),
      rest_per_work_((1.0 - options.core_share) / options.core_share) {}

void RelocalizerLoop::run() {
  while (const RelocalizerLink::Query* const query = link_.wait()) {
    const std::int64_t began_ns = threadCpuNs();
    for (std::size_t i = 0; i < query->T_w_m.size(); ++i) {
      relocalizer_.setPose(static_cast<int>(i), query->T_w_m[i]);
    }
    link_.answer(relocalizer_.locate(query->frame, *query->camera));
    const std::int64_t spent_ns = threadCpuNs() - began_ns;
    publishCounts(spent_ns);
    link_.rest(
        std::chrono::nanoseconds(std::llround(rest_per_work_ * static_cast<double>(spent_ns))));
  }
}

void RelocalizerLoop::publishCounts(std::int64_t spent_ns) {
  const auto tell = [](std::atomic<std::uint64_t>& to, std::uint64_t value) {
    to.store(value, std::memory_order_relaxed);
  };
  const slam::RelocalizationCounts& counts = relocalizer_.counts();
  tell(published_.searches, counts.searches);
  tell(published_.located, counts.located);
  tell(published_.not_verified, counts.not_verified);
  tell(published_.ambiguous, counts.ambiguous);
  tell(published_.alike, counts.alike);
  tell(published_.repeated, counts.repeated);
  published_.spent_ns.fetch_add(spent_ns, std::memory_order_relaxed);
}

void RelocalizerLoop::reportCounters(const CounterSink& sink) const {
  const auto count = [&](const char* name, const std::atomic<std::uint64_t>& value) {
    sink(name, value.load(std::memory_order_relaxed));
  };
  count("relocalizer.searches", published_.searches);
  count("relocalizer.located", published_.located);
  count("relocalizer.not_verified", published_.not_verified);
  count("relocalizer.ambiguous", published_.ambiguous);
  count("relocalizer.alike", published_.alike);
  count("relocalizer.repeated", published_.repeated);
  sink("relocalizer.left_out", link_.leftOut());
  sink("relocalizer.cpu_ms",
       static_cast<std::uint64_t>(published_.spent_ns.load(std::memory_order_relaxed) / 1'000'000));
}

}  // namespace waymark::daemon
