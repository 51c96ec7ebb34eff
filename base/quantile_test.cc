#include "base/quantile.h"

#include <numeric>
#include <vector>

#include <gtest/gtest.h>

namespace waymark {
namespace {

TEST(Quantile, IsTheNearestRankExactly) {
  std::vector<int> sorted(1000);
  std::iota(sorted.begin(), sorted.end(), 1);
  for (std::size_t thousandths = 1; thousandths <= 1000; ++thousandths) {
    EXPECT_EQ(quantile(std::span<const int>(sorted), thousandths), static_cast<int>(thousandths));
  }
  const std::vector<double> three = {1.0, 2.0, 3.0};
  EXPECT_EQ(quantile(std::span(three), 333), 1.0);
  EXPECT_EQ(quantile(std::span(three), 334), 2.0);
  EXPECT_EQ(quantile(std::span(three), 1), 1.0);
}

TEST(TimeQuantiles, OfOneToHundredInAnyOrder) {
  std::vector<std::int64_t> samples(100);
  std::iota(samples.rbegin(), samples.rend(), 1);
  const TimeQuantiles q = timeQuantiles(samples);
  EXPECT_EQ(q.median, 50);
  EXPECT_EQ(q.p99, 99);
  EXPECT_EQ(q.max, 100);
}

TEST(TimeQuantiles, OfOneAndOfNone) {
  std::vector<std::int64_t> one{7};
  EXPECT_EQ(timeQuantiles(one).median, 7);
  EXPECT_EQ(timeQuantiles(one).p99, 7);
  EXPECT_EQ(timeQuantiles({}).max, 0);
}

}  // namespace
}  // namespace waymark
