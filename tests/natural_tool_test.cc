// `waymark natural`, and what `waymark run` says of natural markers, as their users meet them.
#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "io/text/text_file.h"
#include "tests/waymark_tool.h"

namespace waymark::testing {
namespace {

class NaturalTool : public WaymarkTool {
 protected:
  // A sheet with rectangles all over.
  static cv::Mat sheet(std::uint64_t seed, int width = 400, int height = 300) {
    cv::RNG rng(seed);
    cv::Mat image(height, width, CV_8U, cv::Scalar(120));
    for (int i = 0; i < 150; ++i) {
      const cv::Rect at(rng.uniform(0, width - 48), rng.uniform(0, height - 48), rng.uniform(8, 48),
                        rng.uniform(8, 48));
      image(at).setTo(rng.uniform(0, 256));
    }
    return image;
  }
  [[nodiscard]] std::string save(const std::string& name, const cv::Mat& image) const {
    const std::string path = (directory_ / name).string();
    EXPECT_TRUE(cv::imwrite(path, image));
    return path;
  }
  [[nodiscard]] ProgramResult add(const std::string& image,
                                  const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = {"natural", "add", file(), image, "--width", "0.3"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return waymark(arguments);
  }
  [[nodiscard]] std::string file() const { return (directory_ / "natural.json").string(); }
};

TEST_F(NaturalTool, TheSamePictureTwiceIsRefusedWithAndWithoutAlike) {
  ASSERT_EQ(add(save("door.png", sheet(1))).exit_code, 0);
  const std::string before = *io::readTextFile(file());
  const std::string copy = save("copy.png", sheet(1));
  for (const std::vector<std::string>& more : {std::vector<std::string>(), {"--alike"}}) {
    expectBadInput(add(copy, more), "copy.png: is the same picture as that of 'door'");
    EXPECT_EQ(*io::readTextFile(file()), before);
  }
  EXPECT_EQ(waymark({"natural", "check", file(), "--no-rendering"}).exit_code, 0);
}

TEST_F(NaturalTool, PicturesThatLookAlikeAreAddedOnlyWhenAskedForAndToldOfWhenUsed) {
  ASSERT_EQ(add(save("a.png", sheet(1))).exit_code, 0);
  cv::Mat mixed = sheet(1);
  sheet(2).colRange(250, 400).copyTo(mixed.colRange(250, 400));
  const std::string path = save("mixed.png", mixed);
  expectBadInput(add(path), "looks like 'a'");
  ASSERT_EQ(add(path, {"--alike"}).exit_code, 0);
  const ProgramResult result = run(video(), {{"--natural", file()}});
  EXPECT_NE(result.err.find("'a' and 'mixed' look alike ("), std::string::npos) << result.err;
}

TEST_F(NaturalTool, TheDaemonsCheckTellsOfPicturesThatLookAlike) {
  cv::Mat mixed = sheet(1);
  sheet(2).colRange(250, 400).copyTo(mixed.colRange(250, 400));
  (void)save("a.png", sheet(1));
  (void)save("mixed.png", mixed);
  const std::string config = (directory_ / "w.toml").string();
  std::ofstream(config) << "[camera]\nsource = 'grey.avi'\ncalibration = 'calib.yml'\n"
                           "[slam]\ndictionary = '4X4_50'\nmarker_size_m = 0.1\n"
                           "[[natural]]\nname = 'a'\nimage = 'a.png'\nwidth_m = 0.3\n"
                           "[[natural]]\nname = 'b'\nimage = 'mixed.png'\nwidth_m = 0.3\n";
  const ProgramResult result = runProgram({WAYMARKD, "--config", config, "--check"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("'a' and 'b' look alike ("), std::string::npos) << result.err;
  EXPECT_EQ(std::ranges::count(result.err, '\n'), 1) << result.err;
}

TEST_F(NaturalTool, AddSaysWhatOfALargePictureIsUsed) {
  const cv::Mat small = sheet(1, 512, 128);
  cv::Mat large(2000, 8000, CV_8U);
  for (int y = 0; y < large.rows; ++y) {
    for (int x = 0; x < large.cols; ++x) {
      large.at<std::uint8_t>(y, x) = small.at<std::uint8_t>(y * 128 / 2000, x * 512 / 8000);
    }
  }
  const ProgramResult result = add(save("wide.png", large));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("wide.png: has 8000x2000 pixels, of which 512x128 are used\n"),
            std::string::npos)
      << result.out;
}

TEST_F(NaturalTool, ARunSaysThatAConfigurationsNaturalMarkersAreNotUsed) {
  const std::string config = (directory_ / "w.toml").string();
  const auto said = [&](const std::string& more, const std::string& natural = {}) {
    std::ofstream(config) << "[slam]\ndictionary = '4X4_50'\n" << more;
    std::vector<std::pair<std::string, std::string>> options = {{"--config", config}};
    if (!natural.empty()) options.emplace_back("--natural", natural);
    const std::string err = run(video(), options).err;
    return err.find("is not used") == std::string::npos ? std::string() : err;
  };
  EXPECT_EQ(said(""), "");
  const std::string line = config + ": [[natural]] is not used here; --natural FILE.json";
  const std::string natural = "[[natural]]\nname = 'exit'\nimage = 'exit.png'\nwidth_m = 0.3\n";
  EXPECT_NE(said(natural).find(line), std::string::npos);
  EXPECT_NE(said("[relocalizer]\nmarkers = 'n.json'\n").find("relocalizer.markers is not used"),
            std::string::npos);
  ASSERT_EQ(add(save("a.png", sheet(1))).exit_code, 0);
  EXPECT_EQ(said(natural, file()), "") << "the command line wins";
}

TEST_F(NaturalTool, ASequenceNeedsFeaturesAndPhotographsDoNot) {
  ASSERT_EQ(add(save("a.png", sheet(1))).exit_code, 0);
  const std::string config = (directory_ / "w.toml").string();
  std::ofstream(config) << "[slam.natural]\nenabled = false\n";
  expectBadInput(run(video(), {{"--natural", file()}, {"--config", config}}),
                 "--natural: needs slam.natural.enabled");
  std::filesystem::create_directory(directory_ / "photos");
  for (const char* name : {"photos/1.png", "photos/2.png"}) {
    (void)save(name, cv::Mat(kToolHeight, kToolWidth, CV_8U, cv::Scalar(128)));
  }
  const ProgramResult result =
      run((directory_ / "photos").string(), {{"--natural", file()}, {"--config", config}});
  EXPECT_EQ(result.exit_code, 3) << result.err;
}

}  // namespace
}  // namespace waymark::testing
