#include "tools/pose_stream.h"

#include <gtest/gtest.h>

namespace waymark::tools {
namespace {

pose_t poseOf(std::int64_t sequence, bool localized) {
  pose_t pose{};
  pose.sequence = sequence;
  pose.monotonic_ns = 1'000'000'000 + sequence * 10'000'000;
  pose.status = localized ? pose_t::STATUS_TRACKING : pose_t::STATUS_RELOCALIZING;
  pose.source = localized ? pose_t::SOURCE_MARKERS : pose_t::SOURCE_NONE;
  pose.latency_ns = 2'000'000 + sequence * 1000;
  return pose;
}

TEST(PoseStream, CountsGapsRateAndLatency) {
  PoseStream stream;
  for (const std::int64_t sequence : {5, 6, 9, 10}) {
    const pose_t pose = poseOf(sequence, sequence != 6);
    stream.add(pose, pose.monotonic_ns + 3'000'000);
  }
  pose_t absent{};
  absent.status = pose_t::STATUS_NO_CAMERA;
  absent.sequence = 10;
  stream.add(absent, 0);
  stream.addMalformed();

  EXPECT_EQ(stream.messages(), 5);
  EXPECT_EQ(stream.localized(), 3);
  EXPECT_EQ(stream.missing(), 2);
  EXPECT_EQ(stream.summary("# "),
            "# messages: 5, missing frames: 2, restarts: 0, malformed: 1\n"
            "# localized: 3 of 4 frames (75.00 %)\n"
            "# rate: 60.00 Hz over 0.05 s\n"
            "# capture to publication: median 2.006 ms, p99 2.010 ms, max 2.010 ms\n"
            "# capture to receipt (same computer): median 3.000 ms, p99 3.000 ms, max 3.000 ms\n");
}

TEST(PoseStream, ARestartedDaemonIsNoGap) {
  PoseStream stream;
  for (const std::int64_t sequence : {100, 101, 0, 1}) stream.add(poseOf(sequence, true), 0);
  EXPECT_EQ(stream.missing(), 0);
  EXPECT_NE(stream.summary("").find("restarts: 1"), std::string::npos);
}

TEST(PoseStream, TellsWhereTheDaemonLostFrames) {
  PoseStream stream;
  stream.add(poseOf(0, true), 0);
  EXPECT_EQ(stream.summary("").find("dropped"), std::string::npos) << "nobody has said so yet";
  health_t health{};
  const auto count = [&health](const char* name, std::int64_t value) {
    health.counters.emplace_back();
    health.counters.back().name = name;
    health.counters.back().value = value;
  };
  count("camera.frames", 100);
  count("dropped.source_late", 2);
  count("dropped.queue", 7);
  count("deadline.missed", 4);
  stream.add(health);
  stream.add(health);
  EXPECT_NE(stream.summary("# ").find("\n# dropped by the daemon since its start: 2 source_late, 7 "
                                      "queue\n# deadlines missed by the daemon since its start: "
                                      "4\n"),
            std::string::npos)
      << stream.summary("# ");
}

TEST(PoseStream, NothingReceivedIsNoDivisionByZero) {
  EXPECT_EQ(PoseStream().summary("").find("nan"), std::string::npos);
}

}  // namespace
}  // namespace waymark::tools
