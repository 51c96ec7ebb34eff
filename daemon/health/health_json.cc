#include "daemon/health/health_json.h"

#include "daemon/health/status_name.h"

namespace waymark::daemon {
namespace {

const char* cameraName(std::int8_t state) {
  switch (state) {
    case health_t::CAMERA_OPENING:
      return "opening";
    case health_t::CAMERA_RUNNING:
      return "running";
    case health_t::CAMERA_LOST:
      return "lost";
    case health_t::CAMERA_ENDED:
      return "ended";
    default:
      return "unknown";
  }
}

}  // namespace

io::Json healthJson(const health_t& health) {
  io::Json json;
  json["version"] = health.version;
  json["utime"] = health.utime;
  json["monotonic_ns"] = health.monotonic_ns;
  json["uptime_ns"] = health.uptime_ns;
  json["status"] = statusName(health.status);
  json["reason"] = health.reason;
  json["map_piece"] = health.map_piece;
  json["map_pieces"] = health.map_piece_count;
  json["camera"] = {{"state", cameraName(health.camera)}, {"reason", health.camera_reason}};
  json["period_s"] = health.period_s;
  json["frame_rate_hz"] = health.frame_rate_hz;
  json["pose_rate_hz"] = health.pose_rate_hz;
  json["latency_median_ns"] = health.latency_median_ns;
  json["latency_p99_ns"] = health.latency_p99_ns;
  json["latency_max_ns"] = health.latency_max_ns;
  json["processing_median_ns"] = health.processing_median_ns;
  json["processing_max_ns"] = health.processing_max_ns;
  io::Json& counters = json["counters"] = io::Json::object();
  for (const counter_t& counter : health.counters) counters[counter.name] = counter.value;
  io::Json& celsius = json["temperatures_celsius"] = io::Json::object();
  for (const temperature_t& temperature : health.temperatures) {
    celsius[temperature.name] = temperature.celsius;
  }
  return json;
}

}  // namespace waymark::daemon
