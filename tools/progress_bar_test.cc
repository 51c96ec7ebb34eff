#include "tools/progress_bar.h"

#include <string>

#include <gtest/gtest.h>

namespace waymark::tools {
namespace {

TEST(ProgressBar, SaysHowFarAndHowLongStill) {
  const std::string text = progressText(
      {.frames = 100, .total = 400, .seconds = 2.0, .more = "localized 9.0 %", .columns = 120});
  EXPECT_EQ(text, "[=====               ]  25 %  100 frames  50 fps  0:06 left  localized 9.0 %");
  EXPECT_NE(progressText({.frames = 1, .total = 7324, .seconds = 1.0}).find("2:02:03 left"),
            std::string::npos);
}

TEST(ProgressBar, WithoutATotalThereIsNoBar) {
  EXPECT_EQ(progressText({.frames = 30, .seconds = 1.0}), "30 frames  30 fps");
}

TEST(ProgressBar, NeverReachesTheLastColumn) {
  for (const std::size_t columns : {1, 2, 20, 79, 80, 81}) {
    const std::string text = progressText({.frames = 100'000,
                                           .total = 200'000,
                                           .seconds = 1000.0,
                                           .more = std::string(100, 'm'),
                                           .columns = columns});
    EXPECT_EQ(text.size(), columns - 1);
  }
}

TEST(ProgressBar, HeadersPromiseWhatTheyLike) {
  const std::string text = progressText({.frames = 9, .total = 3, .seconds = 1.0});
  EXPECT_EQ(text, "[====================] 100 %  9 frames  9 fps");
}

}  // namespace
}  // namespace waymark::tools
