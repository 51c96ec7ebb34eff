#include "io/slam_settings.h"

#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

using testing::TemporaryDirectory;

Result<SlamSettings> read(const std::string& text) {
  const TemporaryDirectory directory;
  std::ofstream(directory / "w.toml") << text;
  return readSlamSettings(directory / "w.toml");
}

TEST(SlamSettings, NestAsTheOptionsDo) {
  const Result<SlamSettings> s = read(
      "[slam]\ndictionary = '4X4_50'\nmarker_size_m = 0.1\n"
      "[slam.detector]\nscanner.threshold_window_px = 21\n"
      "[slam.keyframes]\nviews_per_marker = 7\n"
      "[slam.local_optimisation]\nmax_iterations = 3\n");
  ASSERT_TRUE(s) << s.error().message;
  EXPECT_EQ(s->dictionary, "4X4_50");
  EXPECT_EQ(s->options.markers.size_m, 0.1);
  EXPECT_EQ(s->options.detector.scanner.threshold_window_px, 21);
  EXPECT_EQ(s->options.mapper.keyframes.views_per_marker, 7);
  EXPECT_EQ(s->options.mapper.local_optimisation.max_iterations, 3);
}

TEST(SlamSettings, OfAFileWithOtherSectionsOrNone) {
  const Result<SlamSettings> s = read(
      "[camera]\nsource = 'sim:walls'\nwhatever = 1\n[queue]\n[publish]\n[log]\n"
      "[slam]\nmarker_size_m = 0.2\n");
  ASSERT_TRUE(s) << s.error().message;
  EXPECT_EQ(s->dictionary, "");
  EXPECT_EQ(s->options.markers.size_m, 0.2);
  ASSERT_TRUE(read(""));
}

TEST(SlamSettings, ErrorsNameThePlace) {
  const auto ends = [](const std::string& text, const std::string& end) {
    const Result<SlamSettings> s = read(text);
    ASSERT_FALSE(s) << text;
    EXPECT_TRUE(s.error().message.ends_with(end)) << s.error().message;
  };
  ends("[slam]\nmarker_size = 1\n", "w.toml:2:1: slam.marker_size: unknown key");
  ends("[slam]\nmarker_size_m = 'a'\n", "w.toml:2:17: slam.marker_size_m: must be a number");
  ends("[slam.detector]\nscanner = 1\n", "w.toml:2:11: slam.detector.scanner: must be a section");
  ends("[slams]\n", "w.toml:1:2: slams: unknown key");
  EXPECT_EQ(readSlamSettings("/nowhere/w.toml").error().message,
            "/nowhere/w.toml: cannot be read: No such file or directory");
}

}  // namespace
}  // namespace waymark::io
