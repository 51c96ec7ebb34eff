#include "view/page_files.h"

#include <string>

#include <gtest/gtest.h>

#include "io/text/json_node.h"
#include "io/text/text_file.h"

namespace waymark::view {
namespace {

TEST(PageFiles, AdviceIsThatOfTheDocument) {
  const Result<std::string> text = io::readTextFile(WAYMARK_HEALTH_MD);
  ASSERT_TRUE(text) << text.error().message;
  const io::Json advice = io::Json::parse(adviceJson(*text));
  EXPECT_GT(advice.size(), 60U);
  EXPECT_TRUE(advice["dropped.queue"]["help"].get<std::string>().starts_with("the SLAM loop is "));
  EXPECT_TRUE(advice.contains("map.save_failures")) << "the second name of a line";
  EXPECT_TRUE(advice.contains("deadline.missed_map"));
}

TEST(PageFiles, AdviceOfOddTextIsNone) {
  for (const char* odd : {"", "| `", "| `a", "| `a` |", "|||||", "| `a | b | c |"}) {
    EXPECT_EQ(adviceJson(odd), "{}") << odd;
  }
}

TEST(PageFiles, WhatIsMissingIsNamed) {
  const auto files = readPageFiles(WAYMARK_VIEW_PAGE, "/nowhere", WAYMARK_HEALTH_MD);
  ASSERT_FALSE(files);
  EXPECT_TRUE(files.error().message.starts_with("/nowhere/three.min.js: cannot be read"))
      << files.error().message;
}

}  // namespace
}  // namespace waymark::view
