// `waymark print` and `waymark calibrate` as their users meet them.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "io/calibrations/calibration_file.h"
#include "slam/testing/synthetic.h"
#include "tests/process.h"
#include "tests/temporary_directory.h"
#include "tools/calibration/testing/drawn_board.h"

namespace waymark {
namespace {

namespace fs = std::filesystem;
using calibration::testing::DrawnBoard;
using calibration::testing::Photographer;
using testing::ProgramResult;
using testing::readFile;
using testing::TemporaryDirectory;

ProgramResult waymark(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), WAYMARK_PROGRAM);
  return testing::runProgram(arguments);
}

void expectBadInput(const ProgramResult& result, const std::string& complaint) {
  EXPECT_EQ(result.exit_code, 2) << result.err;
  EXPECT_NE(result.err.find("waymark: "), std::string::npos) << result.err;
  EXPECT_NE(result.err.find(complaint), std::string::npos) << result.err;
  EXPECT_EQ(result.out, "");
}

TEST(PrintTool, Markers) {
  const TemporaryDirectory directory;
  const std::string pdf = directory / "m.pdf";
  const ProgramResult result = waymark({"print", "--dictionary", "APRILTAG_36h11", "--ids", "0-4,7",
                                        "--marker-size", "0.08", "--page", "letter", "--out", pdf});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.out, "6 markers, 3 pages\n");
  EXPECT_EQ(readFile(pdf).substr(0, 8), "%PDF-1.7");
  EXPECT_NE(readFile(pdf).find("APRILTAG_36h11  id 7  80 mm"), std::string::npos);
}

TEST(PrintTool, BadInput) {
  const TemporaryDirectory directory;
  const std::string pdf = directory / "m.pdf";
  const auto print = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "print");
    arguments.insert(arguments.end(), {"--out", pdf});
    return waymark(arguments);
  };
  expectBadInput(print({}), "--dictionary is required");
  expectBadInput(print({"--dictionary", "5X5_50"}), "--ids is required");
  expectBadInput(print({"--dictionary", "5X5_50", "--ids", "1"}), "--marker-size is required");
  expectBadInput(print({"--dictionary", "5X5_50", "--ids", "49-50", "--marker-size", "0.1"}),
                 "5X5_50 has ids 0 to 49, not 50");
  expectBadInput(print({"--dictionary", "5X5_50", "--ids", "1", "--marker-size", "0.5"}),
                 "the page has room for");
  expectBadInput(
      print({"--dictionary", "5X5_50", "--ids", "1", "--marker-size", "0.1", "--page", "b17"}),
      "--page: 'b17' is unknown");
  expectBadInput(print({"board", "--columns", "2"}), "columns: must be 3 to 200");
  expectBadInput(print({"board", "--board", "none.toml"}), "none.toml: cannot be read");
  EXPECT_TRUE(fs::is_empty(directory.path()));
}

// A printed board's description, and photographs of the board.
class CalibrateTool : public ::testing::Test {
 protected:
  void SetUp() override {
    const ProgramResult printed = waymark({"print", "board", "--out", directory_ / "board.pdf"});
    ASSERT_EQ(printed.exit_code, 0) << printed.err;
    ASSERT_TRUE(fs::exists(directory_ / "board.toml"));
    fs::create_directory(directory_ / "frames");
  }

  void photograph(const std::vector<slam::Transform>& poses) {
    const DrawnBoard board{calibration::BoardOptions{}};
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const std::string name = "photo" + std::to_string(10 + i) + ".png";
      cv::imwrite((directory_ / "frames" / name).string(),
                  photographer_.take(board, poses[i], 0.6, 1.5, static_cast<unsigned>(i)));
    }
  }

  ProgramResult calibrate(const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"calibrate", directory_ / "frames",
                                          "--board",   directory_ / "board.toml",
                                          "--out",     directory_ / "out"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return waymark(arguments);
  }

  const TemporaryDirectory directory_;
  const Photographer photographer_{slam::testing::testCalibration()};
};

TEST_F(CalibrateTool, FromPhotographsToACalibration) {
  photograph(calibration::testing::goodPoses(photographer_.camera(), 0.42, 16));
  const ProgramResult result = calibrate();
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("plumb_bob, 640x480: "), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("+-"), std::string::npos);

  const slam::Calibration truth = slam::testing::testCalibration();
  for (const char* name : {"calib.yml", "camera_info.yaml"}) {
    const auto found = io::readCalibration(directory_ / "out" / name);
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_NEAR(found->fx, truth.fx, 2e-3 * truth.fx);
    EXPECT_NEAR(found->cx, truth.cx, 1.0);
  }
  const auto json = nlohmann::json::parse(readFile(directory_ / "out" / "calibration.json"));
  EXPECT_EQ(json["format"], "waymark-calibration");
  EXPECT_LT(json["rms_px"], 0.15);
  EXPECT_EQ(json["regions"]["cells"].size(), 20U);
  const auto first = json["views"][0]["frame"].get<std::string>();
  EXPECT_TRUE(first.starts_with("photo1") && first.ends_with(".png")) << first;
  const auto& fx = json["parameters"]["fx"];
  EXPECT_LT(std::abs(fx["value"].get<double>() - truth.fx), 4.0 * fx["sigma"].get<double>());
  EXPECT_FALSE(cv::imread((directory_ / "out" / "calibration.png").string()).empty());
}

TEST_F(CalibrateTool, ViewsThatCannotSayAreRejectedWithoutFiles) {
  std::vector<slam::Transform> poses;
  for (int i = 0; i < 9; ++i) {
    const int row = i / 3;
    poses.push_back(calibration::testing::boardAt(photographer_.camera(),
                                                  {160.0 + 160.0 * (i % 3), 120.0 + 110.0 * row},
                                                  0.45, 0.0, 0.0, 0.2 * i));
  }
  photograph(poses);
  const ProgramResult result = calibrate({"--quiet"});
  expectBadInput(result, "the views do not determine the camera: no view tilts the board");
  EXPECT_EQ(std::ranges::count(result.err, '\n'), 1);
  EXPECT_FALSE(fs::exists(directory_ / "out"));
}

TEST_F(CalibrateTool, BadInput) {
  expectBadInput(calibrate(), "has no images");
  cv::imwrite((directory_ / "frames" / "1.png").string(),
              cv::Mat(120, 160, CV_8UC1, cv::Scalar(128)));
  expectBadInput(calibrate(), "the board is in none of 1 frames (ChArUco 7x10, squares 25 mm");
  expectBadInput(calibrate({"--model", "barrel"}), "--model");
  expectBadInput(calibrate({"--first-id", "90"}), "5X5_100 has ids 0 to 99");
  std::ofstream(directory_ / "board.toml") << "[board]\nkind = \"dots\"\n";
  expectBadInput(calibrate(), "board.toml:2:");
  EXPECT_FALSE(fs::exists(directory_ / "out"));
}

// The chapter without a camera: a simulated one, whose lens is known.
TEST(CalibrateSimulated, FindsTheLensOfTheScenes) {
  for (const std::string board : {"charuco", "chessboard"}) {
    const TemporaryDirectory directory;
    const std::string scene = board == "charuco" ? "board" : "chessboard";
    const std::string frames = directory / "scene";
    ASSERT_EQ(
        waymark({"simulate", scene, "--out", frames, "--duration", "40", "--quiet"}).exit_code, 0);
    const ProgramResult result = waymark({"calibrate", frames + "/frames.avi", "--board", board,
                                          "--out", directory / "lens", "--quiet"});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    const auto truth = io::readCalibration(frames + "/calib.yml");
    const auto found = io::readCalibration(directory / "lens" / "calib.yml");
    ASSERT_TRUE(truth && found);
    EXPECT_NEAR(found->fx, truth->fx, 0.5) << board;
    EXPECT_NEAR(found->fy, truth->fy, 0.5) << board;
    EXPECT_NEAR(found->cx, truth->cx, 0.5) << board;
    EXPECT_NEAR(found->cy, truth->cy, 0.5) << board;
    EXPECT_NEAR(found->distortion[0], truth->distortion[0], 0.003) << board;
    ASSERT_TRUE(found->covariance) << board;
    EXPECT_LT(std::abs(found->fx - truth->fx), 4.0 * std::sqrt((*found->covariance)(0, 0)));
  }
}

TEST(BoardOfAChessboard, HasNoMarkers) {
  const TemporaryDirectory directory;
  const std::string pdf = directory / "b.pdf";
  EXPECT_EQ(waymark({"print", "board", "--board", "chessboard", "--out", pdf}).exit_code, 0);
  const std::string toml = readFile(directory / "b.toml");
  EXPECT_NE(toml.find("kind = \"chessboard\""), std::string::npos) << toml;
  EXPECT_EQ(toml.find("marker"), std::string::npos) << toml;
  EXPECT_EQ(waymark({"print", "board", "--board", directory / "b.toml", "--out", pdf}).exit_code, 0)
      << "it reads back";
  expectBadInput(
      waymark({"print", "board", "--board", "chessboard", "--marker-size", "0.01", "--out", pdf}),
      "a chessboard has no markers");
}

// A known layout is a board, too. Real photographs.
TEST(CalibrateRecording, AgreesWithTheCalibrationThatCameWithIt) {
  const char* const shared = std::getenv("WAYMARK_SHARED_DATA");
  const fs::path data = fs::path(shared == nullptr ? "" : shared) / "gridboard20_6x6_photos";
  if (!fs::exists(data)) GTEST_SKIP() << "no real recordings here";
  const TemporaryDirectory directory;
  const ProgramResult result =
      waymark({"calibrate", data / "frames", "--board", data / "gt_map.json", "--dictionary",
               "6X6_1000", "--out", directory / "out"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const auto found = io::readCalibration(directory / "out" / "calib.yml");
  const auto theirs = io::readCalibration(data / "calib.yml");
  ASSERT_TRUE(found && theirs);
  EXPECT_NEAR(found->fx, theirs->fx, 0.01 * theirs->fx);
  const auto json = nlohmann::json::parse(readFile(directory / "out" / "calibration.json"));
  EXPECT_LT(json["rms_px"], 0.41);  // theirs, with corners of another detector
}

}  // namespace
}  // namespace waymark
