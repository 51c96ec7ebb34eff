// The `waymark` command, and what it is given to read. Tests only.
#pragma once

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include "io/calibrations/calibration_file.h"
#include "tests/process.h"
#include "tests/temporary_directory.h"

namespace waymark::testing {

inline constexpr int kToolWidth = 160;
inline constexpr int kToolHeight = 120;

inline ProgramResult waymark(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), WAYMARK_PROGRAM);
  return runProgram(arguments);
}

// A directory with a calibration and a video without markers.
class WaymarkTool : public ::testing::Test {
 protected:
  void SetUp() override {
    const slam::Calibration camera{.width = kToolWidth,
                                   .height = kToolHeight,
                                   .fx = 150.0,
                                   .fy = 150.0,
                                   .cx = 80.0,
                                   .cy = 60.0};
    ASSERT_TRUE(io::writeCalibration(directory_ / "calib.yml", camera).ok());
    cv::VideoWriter writer((directory_ / "grey.avi").string(), cv::CAP_FFMPEG,
                           cv::VideoWriter::fourcc('F', 'F', 'V', '1'), 30.0,
                           {kToolWidth, kToolHeight},
                           /*isColor=*/false);
    for (int i = 0; i < 8; ++i) {
      writer.write(cv::Mat(kToolHeight, kToolWidth, CV_8UC1, cv::Scalar(128)));
    }
  }

  // `waymark run` with what is needed; `changes` replaces values or adds options.
  ProgramResult run(const std::string& source,
                    const std::vector<std::pair<std::string, std::string>>& changes = {}) {
    std::vector<std::pair<std::string, std::string>> options = {
        {"--calibration", (directory_ / "calib.yml").string()},
        {"--dictionary", "ARUCO_ORIGINAL"},
        {"--marker-size", "0.05"},
        {"--out", (directory_ / "out").string()}};
    for (const auto& change : changes) {
      const auto same = [&](const auto& option) { return option.first == change.first; };
      std::erase_if(options, same);
      options.push_back(change);
    }
    std::vector<std::string> arguments = {"run", source};
    for (const auto& [key, value] : options) arguments.insert(arguments.end(), {key, value});
    return waymark(arguments);
  }

  // Exit code 2, one line that contains `complaint`, and no output.
  void expectBadInput(const ProgramResult& result, const std::string& complaint) {
    EXPECT_EQ(result.exit_code, 2) << result.err;
    // A line about the source may come before; the error itself is one line.
    const std::size_t error = result.err.find("waymark: ");
    ASSERT_NE(error, std::string::npos) << result.err;
    EXPECT_NE(result.err.find(complaint, error), std::string::npos) << result.err;
    EXPECT_EQ(
        std::count(result.err.begin() + static_cast<std::ptrdiff_t>(error), result.err.end(), '\n'),
        1)
        << result.err;
    EXPECT_EQ(result.out, "");
    EXPECT_FALSE(std::filesystem::exists(directory_ / "out"));
  }

  [[nodiscard]] std::string video() const { return (directory_ / "grey.avi").string(); }

  const TemporaryDirectory directory_;
};

}  // namespace waymark::testing
