#include "tools/pose_stream.h"

#include <cstdio>
#include <string_view>

#include "base/quantile.h"

namespace waymark::tools {
namespace {

std::string latencyLine(const char* what, std::vector<std::int64_t> samples_ns) {
  const TimeQuantiles q = timeQuantiles(samples_ns);
  char line[160];
  std::snprintf(line, sizeof line, "%s: median %.3f ms, p99 %.3f ms, max %.3f ms\n", what,
                1e-6 * static_cast<double>(q.median), 1e-6 * static_cast<double>(q.p99),
                1e-6 * static_cast<double>(q.max));
  return line;
}

}  // namespace

void PoseStream::add(const pose_t& pose, std::int64_t received_ns) {
  ++messages_;
  if (pose.status == pose_t::STATUS_NO_CAMERA) return;

  if (last_sequence_ && pose.sequence > *last_sequence_) {
    missing_ += pose.sequence - *last_sequence_ - 1;
  } else if (last_sequence_) {
    ++restarts_;
  }
  last_sequence_ = pose.sequence;
  if (frames_ == 0) first_ns_ = pose.monotonic_ns;
  last_ns_ = pose.monotonic_ns;
  ++frames_;
  if (pose.source != pose_t::SOURCE_NONE) ++localized_;
  publish_latency_ns_.push_back(pose.latency_ns);
  receive_latency_ns_.push_back(received_ns - pose.monotonic_ns);
}

// "3 queue, 0 publisher": every cause of a lost frame.
void PoseStream::add(const health_t& health) {
  constexpr std::string_view kDropped = "dropped.";
  drops_.clear();
  for (const counter_t& counter : health.counters) {
    if (counter.name == "deadline.missed") deadlines_missed_ = counter.value;
    if (!counter.name.starts_with(kDropped)) continue;
    drops_ += (drops_.empty() ? "" : ", ") + std::to_string(counter.value) + " " +
              counter.name.substr(kDropped.size());
  }
}

std::string PoseStream::summary(const std::string& prefix) const {
  const auto count = [](std::int64_t n) { return std::to_string(n); };
  const double seconds = 1e-9 * static_cast<double>(last_ns_ - first_ns_);
  const double frames = static_cast<double>(frames_);
  char rate[96];
  std::snprintf(rate, sizeof rate, "rate: %.2f Hz over %.2f s\n",
                seconds > 0.0 ? (frames - 1.0) / seconds : 0.0, seconds);
  char share[96];
  std::snprintf(share, sizeof share, "localized: %s of %s frames (%.2f %%)\n",
                count(localized_).c_str(), count(frames_).c_str(),
                frames_ > 0 ? 100.0 * static_cast<double>(localized_) / frames : 0.0);

  std::string text = prefix + "messages: " + count(messages_) +
                     ", missing frames: " + count(missing_) + ", restarts: " + count(restarts_) +
                     ", malformed: " + count(malformed_) + "\n";
  if (!drops_.empty()) text += prefix + "dropped by the daemon since its start: " + drops_ + "\n";
  if (deadlines_missed_) {
    text += prefix +
            "deadlines missed by the daemon since its start: " + count(*deadlines_missed_) + "\n";
  }
  text += prefix + share + prefix + rate;
  text += prefix + latencyLine("capture to publication", publish_latency_ns_);
  text += prefix + latencyLine("capture to receipt (same computer)", receive_latency_ns_);
  return text;
}

}  // namespace waymark::tools
