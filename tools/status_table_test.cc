#include "tools/status_table.h"

#include <gtest/gtest.h>

namespace waymark::tools {
namespace {

using io::Json;

TEST(StatusTable, SaysWhatPeopleWantToKnow) {
  const Json status = Json::parse(R"({
    "ok": true, "version": "0.1.0", "uptime_ns": 3723000000000, "status": "relocalizing",
    "reason": "no marker in view", "camera": {"state": "running", "reason": ""},
    "frame_rate_hz": 150.04, "pose_rate_hz": 0.0, "latency_median_ns": 1050000,
    "latency_p99_ns": 6296000, "latency_max_ns": 7000000,
    "counters": {"camera.frames": 9, "dropped.queue": 3, "dropped.unsent": 0, "dropped.source_gap": 1},
    "map": {"markers": 48, "natural_markers": 0, "keyframes": 118, "file": "/m/map.json",
            "changed_since_save": true, "last_save": "saved", "last_save_age_s": 75.2},
    "recorder": {"state": "paused", "reason": "the disk is full", "file": ""},
    "log_level": "info"})");
  EXPECT_EQ(statusTable(status),
            "status      relocalizing: no marker in view\n"
            "camera      running\n"
            "rate        150.0 frames/s, 0.0 poses/s\n"
            "latency     median 1.05 ms, 99 % within 6.30 ms, worst 7.00 ms (from mid-exposure to "
            "the network)\n"
            "map         48 markers, 118 keyframes; /m/map.json saved 1 min 15 s ago, changed "
            "since\n"
            "recorder    paused: the disk is full\n"
            "lost frames 3 queue, 1 source_gap (docs/health.md says what helps)\n"
            "log level   info\n"
            "daemon      waymarkd 0.1.0, up 1 h 2 min\n");
}

TEST(StatusTable, TellsHowWellALearnedLensIsKnownAndWhatIsMissing) {
  Json status = Json::parse(R"({
    "lens": {"state": "learning", "fx": 511.96, "focal_sigma_percent": 0.43},
    "counters": {"slam.image_cells_seen": 36}})");
  EXPECT_NE(
      statusTable(status).find(
          "lens        learning, focal length 512.0 px to 0.43 %, markers in 45 % of the image "
          "so far: come nearer to markers, tilt the camera, bring them to the edges of the "
          "image\n"),
      std::string::npos)
      << statusTable(status);
  status["lens"]["state"] = "learned";
  EXPECT_NE(statusTable(status).find("to 0.43 %, markers in 45 % of the image so far\n"),
            std::string::npos)
      << statusTable(status);
  status["lens"]["state"] = "given";  // by a calibration that says how well it was measured
  EXPECT_NE(statusTable(status).find("lens        given, focal length 512.0 px to 0.43 %\n"),
            std::string::npos)
      << statusTable(status);
  status["lens"]["focal_sigma_percent"] = 0.0;
  EXPECT_NE(statusTable(status).find("lens        given, focal length 512.0 px\n"),
            std::string::npos)
      << statusTable(status);
}

TEST(StatusTable, OfLittleItSaysLittle) {
  const std::string table = statusTable(Json::parse(
      R"({"ok": true, "version": "9", "status": "no camera", "map": {"file": ""}, "recorder": null,
          "counters": {"dropped.queue": 0}})"));
  EXPECT_NE(table.find("map         0 markers, 0 keyframes; not saved (slam.map_out is not set)\n"),
            std::string::npos)
      << table;
  EXPECT_NE(table.find("lost frames none\n"), std::string::npos) << table;
  EXPECT_EQ(table.find("latency"), std::string::npos) << table;
  EXPECT_FALSE(statusTable(Json::object()).empty());
  EXPECT_FALSE(statusTable(Json::parse(R"({"map": 3, "camera": "x", "counters": []})")).empty());
}

}  // namespace
}  // namespace waymark::tools
