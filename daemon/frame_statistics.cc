#include "daemon/frame_statistics.h"

#include <algorithm>

namespace waymark::daemon {

Quantiles quantiles(std::span<std::int64_t> samples) {
  if (samples.empty()) return {};
  std::ranges::sort(samples);
  const std::size_t n = samples.size();
  // In whole numbers: ceil(n / 2) and ceil(99 n / 100).
  return {samples[(n + 1) / 2 - 1], samples[(99 * n + 99) / 100 - 1], samples[n - 1]};
}

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
  const Quantiles latency = quantiles(std::span(latency_ns_).first(kept));
  const Quantiles processing = quantiles(std::span(processing_ns_).first(kept));
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
