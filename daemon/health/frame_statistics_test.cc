#include "daemon/health/frame_statistics.h"

#include <gtest/gtest.h>

namespace waymark::daemon {
namespace {

TEST(FrameStatistics, CountsPerSecondOfThePeriodOnly) {
  FrameStatistics statistics;
  health_t message{};
  statistics.report(1'000'000'000, message);
  for (int i = 0; i < 100; ++i) statistics.add(i % 2 == 0, 1000 + i, 10);
  statistics.report(3'000'000'000, message);
  EXPECT_DOUBLE_EQ(message.period_s, 2.0);
  EXPECT_DOUBLE_EQ(message.frame_rate_hz, 50.0);
  EXPECT_DOUBLE_EQ(message.pose_rate_hz, 25.0);
  EXPECT_EQ(message.latency_median_ns, 1049);
  EXPECT_EQ(message.latency_max_ns, 1099);
  EXPECT_EQ(message.processing_max_ns, 10);

  statistics.report(4'000'000'000, message);
  EXPECT_DOUBLE_EQ(message.frame_rate_hz, 0.0);
  EXPECT_EQ(message.latency_max_ns, 0);
}

TEST(FrameStatistics, TakesMoreFramesThanItKeeps) {
  FrameStatistics statistics;
  health_t message{};
  statistics.report(1'000'000'000, message);
  for (int i = 0; i < 5000; ++i) statistics.add(true, i, i);
  statistics.report(2'000'000'000, message);
  EXPECT_DOUBLE_EQ(message.frame_rate_hz, 5000.0);
  EXPECT_GT(message.latency_max_ns, 0);
}

}  // namespace
}  // namespace waymark::daemon
