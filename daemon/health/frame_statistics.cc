#include "daemon/health/frame_statistics.h"

#include <algorithm>
#include <span>

#include "base/quantile.h"

namespace waymark::daemon {

void FrameStatistics::add(bool localized, std::int64_t latency_ns, std::int64_t processing_ns) {
  if (frames_ < kMaxSamples) {
    latency_ns_[frames_] = latency_ns;
    processing_ns_[frames_] = processing_ns;
  }
  ++frames_;
  if (localized) ++localized_;
}

void FrameStatistics::report(std::int64_t now_ns, health_t& message) {
  const std::size_t kept = std::min(frames_, kMaxSamples);
  const TimeQuantiles latency = timeQuantiles(std::span(latency_ns_).first(kept));
  const TimeQuantiles processing = timeQuantiles(std::span(processing_ns_).first(kept));
  const double period_s = begin_ns_ == 0 ? 0.0 : 1e-9 * static_cast<double>(now_ns - begin_ns_);
  message.period_s = period_s;
  message.frame_rate_hz = period_s > 0.0 ? static_cast<double>(frames_) / period_s : 0.0;
  message.pose_rate_hz = period_s > 0.0 ? static_cast<double>(localized_) / period_s : 0.0;
  message.latency_median_ns = latency.median;
  message.latency_p99_ns = latency.p99;
  message.latency_max_ns = latency.max;
  message.processing_median_ns = processing.median;
  message.processing_max_ns = processing.max;
  begin_ns_ = now_ns;
  frames_ = 0;
  localized_ = 0;
}

}  // namespace waymark::daemon
