#include "slam/map/marker_options.h"

#include <cmath>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

MarkerOptions valid() {
  MarkerOptions options;
  options.size_m = 0.1;
  return options;
}

TEST(MarkerOptions, TheFirstRangeWithAnIdGivesItsSize) {
  MarkerOptions options = valid();
  options.other_sizes = {{{10, 19}, 0.2}, {{15, 30}, 0.3}};
  EXPECT_EQ(options.sizeOf(9), 0.1);
  EXPECT_EQ(options.sizeOf(10), 0.2);
  EXPECT_EQ(options.sizeOf(19), 0.2) << "the last id belongs to the range; the first range counts";
  EXPECT_EQ(options.sizeOf(20), 0.3);
  EXPECT_EQ(options.sizeOf(31), 0.1);
}

TEST(MarkerOptions, IgnoresRangesOfIds) {
  MarkerOptions options = valid();
  EXPECT_FALSE(options.isIgnored(0));
  options.ignored = {{0, 0}, {5, 7}};
  for (const int id : {0, 5, 6, 7}) EXPECT_TRUE(options.isIgnored(id)) << id;
  for (const int id : {1, 4, 8}) EXPECT_FALSE(options.isIgnored(id)) << id;
}

// Each mistake by itself, and a word that its reason must have.
TEST(MarkerOptions, SaysWhatIsWrong) {
  EXPECT_EQ(valid().invalidReason(), "");
  const auto reason = [](const auto& spoil) {
    MarkerOptions options = valid();
    spoil(&options);
    return options.invalidReason();
  };
  using Options = MarkerOptions;
  for (const double size_m : {0.0, -0.1, double(NAN), double(INFINITY)}) {
    EXPECT_NE(reason([&](Options* o) { o->size_m = size_m; }).find("size"), std::string::npos);
  }
  EXPECT_NE(reason([](Options* o) {
              o->other_sizes = {{{3, 5}, 0.0}};
            }).find("3-5"),
            std::string::npos);
  EXPECT_NE(reason([](Options* o) {
              o->other_sizes = {{{5, 3}, 0.1}};
            }).find("5-3"),
            std::string::npos);
  EXPECT_NE(reason([](Options* o) { o->ignored = {{9, 8}}; }).find("9-8"), std::string::npos);
  EXPECT_NE(reason([](Options* o) {
              o->origin_marker = 1;
              o->anchors = {{2, {}}};
            }).find("only one"),
            std::string::npos);
  EXPECT_NE(reason([](Options* o) {
              o->anchors = {{2, {}}, {2, {}}};
            }).find("twice"),
            std::string::npos);
  EXPECT_NE(reason([](Options* o) {
              o->anchors = {{2, {}, 0.0}};
            }).find("sigma"),
            std::string::npos);
  EXPECT_NE(reason([](Options* o) {
              o->anchors = {{2, {}, 0.001, -1.0}};
            }).find("sigma"),
            std::string::npos);
  EXPECT_NE(reason([](Options* o) {
              o->anchors = {{2, {}}};
              o->ignored = {{1, 3}};
            }).find("anchor 2"),
            std::string::npos);
  EXPECT_NE(reason([](Options* o) {
              o->origin_marker = 2;
              o->ignored = {{1, 3}};
            }).find("origin"),
            std::string::npos);
}

}  // namespace
}  // namespace waymark::slam
