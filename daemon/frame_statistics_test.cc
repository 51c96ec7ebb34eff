#include "daemon/frame_statistics.h"

#include <algorithm>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::daemon {
namespace {

TEST(Quantiles, OfOneToHundred) {
  std::vector<std::int64_t> samples(100);
  std::iota(samples.rbegin(), samples.rend(), 1);
  const Quantiles q = quantiles(samples);
  EXPECT_EQ(q.median, 50);
  EXPECT_EQ(q.p99, 99);
  EXPECT_EQ(q.max, 100);
}

TEST(Quantiles, OfOneAndOfNone) {
  std::vector<std::int64_t> one{7};
  EXPECT_EQ(quantiles(one).median, 7);
  EXPECT_EQ(quantiles(one).p99, 7);
  EXPECT_EQ(quantiles({}).max, 0);
}

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
