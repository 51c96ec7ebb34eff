#include "io/settings/marker_ids.h"

#include <string>

#include <gtest/gtest.h>

namespace waymark::io {
namespace {

TEST(MarkerIds, Ranges) {
  const auto ranges = parseIdRanges("3, 7-9,0");
  ASSERT_TRUE(ranges) << ranges.error().message;
  ASSERT_EQ(ranges->size(), 3U);
  EXPECT_EQ((*ranges)[0].first, 3);
  EXPECT_EQ((*ranges)[0].last, 3);
  EXPECT_EQ((*ranges)[1].first, 7);
  EXPECT_EQ((*ranges)[1].last, 9);
  EXPECT_EQ((*ranges)[2].last, 0);
}

TEST(MarkerIds, RangesThatAreNone) {
  for (const char* text : {"", "x", "3,,4", "-3", "3-", "3-4-5", "1.5", "99999999999"}) {
    const auto ranges = parseIdRanges(text);
    ASSERT_FALSE(ranges) << text;
    EXPECT_NE(ranges.error().message.find("must be an id or a range"), std::string::npos) << text;
  }
  EXPECT_EQ(parseIdRanges("9-7").error().message, "the range '9-7' is empty");
}

TEST(MarkerIds, Sizes) {
  const auto sizes = parseMarkerSizes("10-19=0.2, 42 = 0.05");
  ASSERT_TRUE(sizes) << sizes.error().message;
  ASSERT_EQ(sizes->size(), 2U);
  EXPECT_EQ((*sizes)[0].ids.last, 19);
  EXPECT_EQ((*sizes)[0].size_m, 0.2);
  EXPECT_EQ((*sizes)[1].ids.first, 42);
  EXPECT_EQ((*sizes)[1].size_m, 0.05);
  for (const char* text : {"", "10", "10=", "10=x", "10=0", "10=-1", "10=inf", "x=0.1", "9-7=1"}) {
    EXPECT_FALSE(parseMarkerSizes(text)) << text;
  }
}

}  // namespace
}  // namespace waymark::io
