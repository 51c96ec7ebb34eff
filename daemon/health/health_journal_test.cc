#include "daemon/health/health_journal.h"

#include <string>

#include <gtest/gtest.h>

#include <waymark/pose_t.hpp>

namespace waymark::daemon {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

health_t healthAt(std::int64_t ns, std::int8_t status, const std::string& reason = "") {
  health_t health{};
  health.monotonic_ns = ns;
  health.status = status;
  health.reason = reason;
  return health;
}

void count(health_t* health, const std::string& name, std::int64_t value) {
  health->counters.push_back({});
  health->counters.back().name = name;
  health->counters.back().value = value;
}

TEST(HealthJournal, TellsAStateOnce) {
  HealthJournal journal;
  EXPECT_EQ(journal.changes(healthAt(1 * kSecond, pose_t::STATUS_TRACKING)).state, "tracking");
  EXPECT_EQ(journal.changes(healthAt(9 * kSecond, pose_t::STATUS_TRACKING)).state, "");
  EXPECT_EQ(journal.changes(healthAt(10 * kSecond, pose_t::STATUS_RELOCALIZING, "no marker")).state,
            "relocalizing: no marker");
}

TEST(HealthJournal, SaysThePieceOfAMapInPieces) {
  health_t health{};
  health.status = pose_t::STATUS_TRACKING;
  health.map_piece_count = 1;
  EXPECT_EQ(HealthJournal::describeState(health), "tracking");
  health.map_piece = 2;
  health.map_piece_count = 3;
  EXPECT_EQ(HealthJournal::describeState(health), "tracking; in piece 2 of a map of 3 pieces");
}

TEST(HealthJournal, AFlickeringStateIsToldAsItEndsUp) {
  HealthJournal journal;
  EXPECT_NE(journal.changes(healthAt(0, pose_t::STATUS_TRACKING)).state, "");
  EXPECT_EQ(journal.changes(healthAt(kSecond / 4, pose_t::STATUS_RELOCALIZING)).state, "");
  EXPECT_EQ(journal.changes(healthAt(kSecond / 2, pose_t::STATUS_TRACKING)).state, "");
  EXPECT_EQ(journal.changes(healthAt(2 * kSecond, pose_t::STATUS_TRACKING)).state, "")
      << "as told before";
  EXPECT_EQ(journal.changes(healthAt(2 * kSecond + 1, pose_t::STATUS_NO_CAMERA, "gone")).state,
            "no camera: gone");
}

TEST(HealthJournal, FaultsAreToldByHowMuchTheyHaveGrown) {
  HealthJournal journal;
  health_t health = healthAt(0, pose_t::STATUS_TRACKING);
  count(&health, "dropped.queue", 3);
  count(&health, "camera.frames", 100);
  count(&health, "deadline.missed", 0);
  EXPECT_EQ(journal.changes(health).faults, "dropped.queue +3 (3)");
  health.counters[0].value = 5;
  health.monotonic_ns = 1 * kSecond;
  EXPECT_EQ(journal.changes(health).faults, "") << "not so soon";
  health.monotonic_ns = 10 * kSecond;
  health.counters[2].value = 1;
  EXPECT_EQ(journal.changes(health).faults, "dropped.queue +2 (5), deadline.missed +1 (1)");
  health.monotonic_ns = 30 * kSecond;
  EXPECT_EQ(journal.changes(health).faults, "");
}

TEST(HealthJournal, TellsOfAnotherLensOnce) {
  HealthJournal journal;
  health_t health{};
  health.lens.fx = 492.2;
  EXPECT_EQ(journal.changes(health).lens, "");
  health.monotonic_ns += 5'000'000'000;
  health.lens.fx = 502.4;
  health.lens.changes = 1;
  health.lens.focal_sigma = 0.0003;
  health.lens.rms_before_px = 1.6;
  health.lens.rms_after_px = 0.06;
  const std::string told = journal.changes(health).lens;
  for (const char* part : {"502.40 px", "492.20 before", "0.03 %", "0.06 px", "1.60 before"}) {
    EXPECT_NE(told.find(part), std::string::npos) << part << ": " << told;
  }
  health.monotonic_ns += 5'000'000'000;
  EXPECT_EQ(journal.changes(health).lens, "");
  // Another map was begun: its SLAM has this lens as given.
  health.lens.changes = 0;
  health.monotonic_ns += 60 * kSecond;
  EXPECT_EQ(journal.changes(health).lens, "");
}

}  // namespace
}  // namespace waymark::daemon
