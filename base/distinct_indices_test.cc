#include "base/distinct_indices.h"

#include <vector>

#include <gtest/gtest.h>

namespace waymark {
namespace {

std::vector<int> sorted(DistinctIndices* distinct, std::vector<int> indices) {
  distinct->sort(&indices);
  return indices;
}

TEST(DistinctIndices, AreSortedWithoutRepeats) {
  DistinctIndices distinct(10);
  EXPECT_EQ(sorted(&distinct, {7, 3, 7, 7, 0, 3, 9, 0}), (std::vector<int>{0, 3, 7, 9}));
  EXPECT_EQ(sorted(&distinct, {9, 7}), (std::vector<int>{7, 9})) << "of each list by itself";
  EXPECT_TRUE(sorted(&distinct, {}).empty());
}

}  // namespace
}  // namespace waymark
