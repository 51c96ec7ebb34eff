#include "daemon/health/health_json.h"

#include <gtest/gtest.h>

#include <waymark/pose_t.hpp>

namespace waymark::daemon {
namespace {

TEST(HealthJson, HoldsEveryField) {
  health_t health{};
  health.version = "1.2.3";
  health.uptime_ns = 7;
  health.status = pose_t::STATUS_RELOCALIZING;
  health.reason = "no marker is in view";
  health.camera = health_t::CAMERA_LOST;
  health.camera_reason = "unplugged";
  health.pose_rate_hz = 149.5;
  health.counters.resize(2);
  health.counters[0].name = "dropped.queue";
  health.counters[0].value = 3;
  health.counters[1].name = "slam.frames";
  health.counters[1].value = 100;
  health.temperatures.resize(1);
  health.temperatures[0].name = "cpu";
  health.temperatures[0].celsius = 51.5;
  health.map_piece = 4;
  health.map_piece_count = 2;
  const io::Json json = healthJson(health);
  EXPECT_EQ(json["version"], "1.2.3");
  EXPECT_EQ(json["uptime_ns"], 7);
  EXPECT_EQ(json["status"], "relocalizing");
  EXPECT_EQ(json["reason"], "no marker is in view");
  EXPECT_EQ(json["camera"], (io::Json{{"state", "lost"}, {"reason", "unplugged"}}));
  EXPECT_EQ(json["pose_rate_hz"], 149.5);
  EXPECT_EQ(json["counters"], (io::Json{{"dropped.queue", 3}, {"slam.frames", 100}}));
  EXPECT_EQ(json["map_piece"], 4);
  EXPECT_EQ(json["map_pieces"], 2);
  EXPECT_EQ(json["temperatures_celsius"], (io::Json{{"cpu", 51.5}}));
}

}  // namespace
}  // namespace waymark::daemon
