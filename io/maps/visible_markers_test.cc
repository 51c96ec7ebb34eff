#include "io/maps/visible_markers.h"

#include <gtest/gtest.h>

#include "io/text/text_file.h"
#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

using waymark::testing::TemporaryDirectory;

TEST(VisibleMarkers, WhatWasWrittenReadsBack) {
  const TemporaryDirectory directory;
  const std::vector<VisibleMarker> written = {{0, 3, 20.25}, {0, 5, 31.5}, {16'666'667, 3, 0.0}};
  ASSERT_TRUE(writeTextFile(directory / "gt_visible.csv", formatVisibleMarkers(written)).ok());
  const auto read = readVisibleMarkers(directory / "gt_visible.csv");
  ASSERT_TRUE(read.ok()) << read.error().message;
  ASSERT_EQ(read->size(), written.size());
  for (std::size_t i = 0; i < written.size(); ++i) {
    EXPECT_EQ((*read)[i].time_ns, written[i].time_ns);
    EXPECT_EQ((*read)[i].id, written[i].id);
    EXPECT_DOUBLE_EQ((*read)[i].side_px, written[i].side_px);
  }
}

TEST(VisibleMarkers, FaultsNameTheLine) {
  const TemporaryDirectory directory;
  for (const auto& [text, complaint] : {std::pair{"1,2\n", ":1: has 2 fields"},
                                        {"# t\n1,2,30\n1,x,30\n", ":3: must be a time"},
                                        {"1,2,-3\n", ":1: must be a time"},
                                        {"soon,2,30\n", ":1: must be a time"}}) {
    ASSERT_TRUE(writeTextFile(directory / "gt_visible.csv", text).ok());
    const auto read = readVisibleMarkers(directory / "gt_visible.csv");
    ASSERT_FALSE(read.ok()) << text;
    EXPECT_NE(read.error().message.find(std::string("gt_visible.csv") + complaint),
              std::string::npos)
        << read.error().message;
  }
  EXPECT_FALSE(readVisibleMarkers(directory / "missing.csv").ok());
}

}  // namespace
}  // namespace waymark::io
