#include "tools/status_table.h"

#include <cstdint>
#include <string_view>

#include "io/text/number_text.h"
#include "slam/camera/corner_coverage.h"
#include "tools/diagnosis/source_report.h"

namespace waymark::tools {
namespace {

using io::fixed;
using io::Json;

std::string textAt(const Json& json, const char* key) {
  const auto found = json.find(key);
  return found != json.end() && found->is_string() ? io::oneLine(found->get<std::string>())
                                                   : std::string();
}

double numberAt(const Json& json, const char* key) {
  const auto found = json.find(key);
  return found != json.end() && found->is_number() ? found->get<double>() : 0.0;
}

Json partAt(const Json& json, const char* key) {
  const auto found = json.find(key);
  return found != json.end() && found->is_object() ? *found : Json::object();
}

void add(const char* what, const std::string& value, std::string* table) {
  if (value.empty()) return;
  *table += std::string(what) + std::string(12 - std::string_view(what).size(), ' ') + value + "\n";
}

std::string withReason(const std::string& state, const std::string& reason) {
  return state + (reason.empty() || state.empty() ? "" : ": " + reason);
}

std::string lasting(double seconds) {
  const auto all = static_cast<std::int64_t>(seconds);
  if (all < 60) return fixed(seconds, 0) + " s";
  if (all < 3600) return std::to_string(all / 60) + " min " + std::to_string(all % 60) + " s";
  if (all < 86400) {
    return std::to_string(all / 3600) + " h " + std::to_string(all / 60 % 60) + " min";
  }
  return std::to_string(all / 86400) + " d " + std::to_string(all / 3600 % 24) + " h";
}

std::string ms(double ns) { return fixed(1e-6 * ns, 2) + " ms"; }

std::string latency(const Json& status) {
  if (numberAt(status, "latency_max_ns") <= 0.0) return {};
  return "median " + ms(numberAt(status, "latency_median_ns")) + ", 99 % within " +
         ms(numberAt(status, "latency_p99_ns")) + ", worst " +
         ms(numberAt(status, "latency_max_ns")) + " (from mid-exposure to the network)";
}

std::string mapText(const Json& map) {
  if (map.empty()) return {};
  std::string text = fixed(numberAt(map, "markers"), 0) + " markers, " +
                     fixed(numberAt(map, "keyframes"), 0) + " keyframes";
  if (const double pictures = numberAt(map, "natural_markers"); pictures > 0.0) {
    text += ", " + fixed(pictures, 0) + " natural markers";
  }
  if (const double pieces = numberAt(map, "pieces"); pieces > 1.0) {
    text += " in " + fixed(pieces, 0) + " pieces";
  }
  const std::string file = textAt(map, "file");
  if (file.empty()) return text + "; not saved (slam.map_out is not set)";
  const auto age = map.find("last_save_age_s");
  const bool saved = age != map.end() && age->is_number();
  text +=
      "; " + file + (saved ? " saved " + lasting(age->get<double>()) + " ago" : " not saved yet");
  if (map.value("changed_since_save", false)) text += ", changed since";
  return text;
}

// "3 queue, 1 source_gap"; every cause of a lost frame that there was.
std::string dropped(const Json& counters) {
  constexpr std::string_view kDropped = "dropped.";
  std::string text;
  for (const auto& [name, value] : counters.items()) {
    if (!name.starts_with(kDropped) || !value.is_number() || value == 0) continue;
    text += (text.empty() ? "" : ", ") + value.dump() + " " + name.substr(kDropped.size());
  }
  return text.empty() ? "none" : text + " (docs/health.md says what helps)";
}

// `counters` tell where in the image markers have been.
std::string lensText(const Json& lens, const Json& counters) {
  const std::string state = textAt(lens, "state");
  std::string text = state + ", focal length " + fixed(numberAt(lens, "fx"), 1) + " px";
  const double sigma_percent = numberAt(lens, "focal_sigma_percent");
  if (sigma_percent > 0.0) text += " to " + fixed(sigma_percent, 2) + " %";
  if (state == "given") return text;
  const double cells = numberAt(counters, "slam.image_cells_seen");
  text += ", markers in " + fixed(100.0 * cells / slam::CornerCoverage::kCells, 0) +
          " % of the image so far";
  if (state == "learning") text += std::string(": ") + diagnosis::kWhatTeachesALens;
  return text;
}

}  // namespace

std::string statusTable(const Json& status) {
  std::string table;
  add("status", withReason(textAt(status, "status"), textAt(status, "reason")), &table);
  const Json camera = partAt(status, "camera");
  add("camera", withReason(textAt(camera, "state"), textAt(camera, "reason")), &table);
  add("rate",
      fixed(numberAt(status, "frame_rate_hz"), 1) + " frames/s, " +
          fixed(numberAt(status, "pose_rate_hz"), 1) + " poses/s",
      &table);
  add("latency", latency(status), &table);
  add("map", mapText(partAt(status, "map")), &table);
  const Json lens = partAt(status, "lens");
  const Json counters = partAt(status, "counters");
  if (!lens.empty()) add("lens", lensText(lens, counters), &table);
  const Json recorder = partAt(status, "recorder");
  add("recorder",
      recorder.empty()
          ? "not configured"
          : withReason(textAt(recorder, "state"), textAt(recorder, "reason")) +
                (textAt(recorder, "file").empty() ? "" : ", ") + textAt(recorder, "file"),
      &table);
  if (!counters.empty()) add("lost frames", dropped(counters), &table);
  add("log level", textAt(status, "log_level"), &table);
  add("daemon",
      "waymarkd " + textAt(status, "version") + ", up " +
          lasting(1e-9 * numberAt(status, "uptime_ns")),
      &table);
  return table;
}

}  // namespace waymark::tools
