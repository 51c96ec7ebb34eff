// The numbers of LiveState as Prometheus reads them.
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>

#include "daemon/health/status_name.h"
#include "io/text/number_text.h"
#include "view/live_state.h"

namespace waymark::view {
namespace {

// Of a label: what ends the text, or the line, is escaped.
std::string label(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '\\' || c == '"') escaped += '\\';
    escaped += c == '\n' ? std::string("\\n") : std::string(1, c);
  }
  return escaped;
}

std::string number(double value) {
  constexpr double kExact = 9007199254740992.0;  // up to here whole numbers are
  if (!std::isfinite(value)) return "NaN";
  if (value == std::floor(value) && std::abs(value) < kExact) {
    return std::to_string(static_cast<std::int64_t>(value));
  }
  return io::roundTrip(value);
}

class Metrics {
 public:
  void head(const char* name, const char* type, const char* help) {
    text_ += std::string("# HELP ") + name + " " + help + "\n# TYPE " + name + " " + type + "\n";
  }
  void value(const std::string& name, double value) { text_ += name + " " + number(value) + "\n"; }
  void gauge(const char* name, const char* help, double of) {
    head(name, "gauge", help);
    value(name, of);
  }
  [[nodiscard]] std::string text() && { return std::move(text_); }

 private:
  std::string text_;
};

}  // namespace

std::string LiveState::metricsText() const {
  Metrics metrics;
  metrics.gauge("waymark_up", "1 while the daemon says something.", alive_ ? 1.0 : 0.0);
  if (pose_) {
    metrics.head("waymark_status", "gauge", "1 for what the daemon is doing.");
    metrics.value("waymark_status{status=\"" + label(daemon::statusName(pose_->status)) + "\"}", 1);
    metrics.gauge("waymark_has_pose", "1 if the last frame had a pose.",
                  pose_->source == pose_t::SOURCE_NONE ? 0.0 : 1.0);
    metrics.gauge("waymark_markers_used", "Markers that the last pose is from.",
                  pose_->markers_used);
    metrics.gauge("waymark_reprojection_rms_pixels", "Of the last pose.",
                  pose_->reprojection_rms_px);
    metrics.head("waymark_frames_missed_total", "counter", "Frames of which nothing came here.");
    metrics.value("waymark_frames_missed_total", static_cast<double>(missing_));
  }
  if (!map_.whole().empty()) {
    const map_t& map = map_.whole().begin()->second;
    metrics.gauge("waymark_map_markers", "Markers with a pose.", map.marker_count);
    metrics.gauge("waymark_map_keyframes", "Keyframes of the map.", map.keyframe_count);
  }
  if (!health_) return std::move(metrics).text();
  const health_t& h = *health_;
  metrics.gauge("waymark_frame_rate_hertz", "Frames processed.", h.frame_rate_hz);
  metrics.gauge("waymark_pose_rate_hertz", "Frames with a pose.", h.pose_rate_hz);
  metrics.gauge("waymark_uptime_seconds", "Since the daemon started.",
                1e-9 * static_cast<double>(h.uptime_ns));
  metrics.head("waymark_latency_seconds", "gauge",
               "From mid-exposure to the network, in the last second.");
  metrics.value("waymark_latency_seconds{quantile=\"0.5\"}",
                1e-9 * static_cast<double>(h.latency_median_ns));
  metrics.value("waymark_latency_seconds{quantile=\"0.99\"}",
                1e-9 * static_cast<double>(h.latency_p99_ns));
  metrics.value("waymark_latency_seconds{quantile=\"1\"}",
                1e-9 * static_cast<double>(h.latency_max_ns));
  metrics.head("waymark_events_total", "counter", "The daemon's counters; docs/health.md.");
  for (const counter_t& counter : h.counters) {
    metrics.value("waymark_events_total{name=\"" + label(counter.name) + "\"}",
                  static_cast<double>(counter.value));
  }
  metrics.head("waymark_temperature_celsius", "gauge", "Of the computer.");
  for (const temperature_t& temperature : h.temperatures) {
    metrics.value("waymark_temperature_celsius{name=\"" + label(temperature.name) + "\"}",
                  temperature.celsius);
  }
  return std::move(metrics).text();
}

}  // namespace waymark::view
