// `waymark run` and others on a short walk: what ends it early, what it says of it, what is left.
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include "tests/process.h"
#include "tests/small_disk.h"
#include "tests/waymark_tool.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;

// A short walk as images, of a camera whose calibration lies beside them.
class InterruptedRun : public WaymarkTool {
 protected:
  void SetUp() override {
    WaymarkTool::SetUp();
    const fs::path walk = directory_ / "walk";
    ASSERT_EQ(waymark({"simulate", "walls", "--duration", "2", "--fps", "10", "--quiet", "--out",
                       walk.string()})
                  .exit_code,
              0);
    fs::create_directory(images_);
    cv::VideoCapture video((walk / "frames.avi").string());
    std::ofstream times(images_ / "frames.txt");
    cv::Mat image;
    for (int i = 10; video.read(image); ++i) {
      const std::string name = std::to_string(i) + ".png";
      cv::imwrite((images_ / name).string(), image);
      times << name << " " << 0.1 * i << "\n";
    }
  }
  [[nodiscard]] std::vector<std::pair<std::string, std::string>> options() const {
    return {{"--calibration", (directory_ / "walk" / "calib.yml").string()},
            {"--dictionary", "ARUCO_MIP_36h12"},
            {"--marker-size", "0.123"}};
  }
  [[nodiscard]] nlohmann::json statistics() const {
    return nlohmann::json::parse(readFile(directory_ / "out" / "stats.json"));
  }
  [[nodiscard]] int poses(const char* name) const {
    std::ifstream file(directory_ / "out" / name);
    int count = 0;
    for (std::string line; std::getline(file, line);) count += line.starts_with('#') ? 0 : 1;
    return count;
  }

  const fs::path images_ = directory_ / "images";
};

TEST_F(InterruptedRun, ABadImageAtTheEndCostsNoMoreThanItself) {
  std::ofstream(images_ / "29.png") << "no image";
  const ProgramResult result = run(images_.string(), options());
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(
      result.err.find("29.png: is not a readable image; the results are of the frames before"),
      std::string::npos)
      << result.err;
  const nlohmann::json told = statistics();
  EXPECT_NE(told["incomplete"].get<std::string>().find("29.png"), std::string::npos);
  EXPECT_EQ(told["frames"], 19);
  EXPECT_EQ(poses("trajectory.tum"), told["localized"].get<int>());
  EXPECT_GE(poses("trajectory_final.tum"), 15);
  for (const char* every : {"poses.csv", "poses_final.csv"}) {
    const std::string lines = readFile(directory_ / "out" / every);
    EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 1 + 19) << every;
  }
  EXPECT_TRUE(fs::exists(directory_ / "out" / "map.json"));
}

TEST_F(InterruptedRun, TheVerdictIsGoodOrSaysWhatIsWrong) {
  const ProgramResult good = run(images_.string(), options());
  EXPECT_EQ(good.exit_code, 0) << good.err;
  EXPECT_NE(good.out.find("\nverdict: good: a pose in 100.0 % of 20 frames, reprojection error "),
            std::string::npos)
      << good.out;
  EXPECT_EQ(statistics()["verdict"]["grade"], "good");

  std::vector<std::pair<std::string, std::string>> wrong = options();
  wrong[1].second = "APRILTAG_36h11";
  const ProgramResult other = run(images_.string(), wrong);
  EXPECT_EQ(other.exit_code, 3) << other.err;
  EXPECT_NE(other.out.find("squares decode as ARUCO_MIP_36h12"), std::string::npos) << other.out;
  EXPECT_NE(other.out.find(": --dictionary ARUCO_MIP_36h12\n"), std::string::npos) << other.out;
  EXPECT_NE(other.err.find("the results that were in "), std::string::npos) << other.err;
  const fs::path kept = directory_ / "out" / "previous" / "stats.json";
  EXPECT_EQ(nlohmann::json::parse(readFile(kept))["verdict"]["grade"], "good");

  wrong = options();
  wrong[2].second = "50";
  const ProgramResult huge = run(images_.string(), wrong);
  EXPECT_NE(huge.out.find("verdict: doubtful: "), std::string::npos) << huge.out;
  EXPECT_NE(huge.out.find("--marker-size is the side of the black square in metres"),
            std::string::npos)
      << huge.out;
}

TEST_F(InterruptedRun, TheDoctorLooksAtImages) {
  const ProgramResult good = waymark(
      {"doctor", images_.string(), "--calibration", (directory_ / "walk" / "calib.yml").string()});
  EXPECT_EQ(good.exit_code, 0) << good.err;
  for (const char* finding :
       {"good  times      20 frames at 10.0 Hz", "good  light ", "good  focus ",
        "good  markers    ARUCO_MIP_36h12: ", "  motion     markers move by ",
        "good  poses      a pose in 100.0 % of 20 frames"}) {
    EXPECT_NE(good.out.find(finding), std::string::npos) << finding << "\n" << good.out;
  }
  const ProgramResult other = waymark({"doctor", images_.string(), "--dictionary", "4X4_50"});
  EXPECT_NE(other.out.find("asked for was 4X4_50"), std::string::npos) << other.out;
  const ProgramResult nothing = waymark({"doctor", video()});
  EXPECT_EQ(nothing.exit_code, 3) << nothing.out << nothing.err;
  EXPECT_NE(nothing.out.find("BAD   markers    none of any family"), std::string::npos);
  expectBadInput(waymark({"doctor", "missing.avi"}), "missing.avi: no such file");
  expectBadInput(waymark({"doctor", video(), "--dictionary", "5X5"}), "--dictionary: \"5X5\"");
}

// A video's decoder has threads of its own.
TEST_F(InterruptedRun, ASignalEndsTheFramesAndNotTheResults) {
  for (const fs::path& source : {images_, directory_ / "walk" / "frames.avi"}) {
    SCOPED_TRACE(source);
    std::vector<std::string> command = {
        WAYMARK_PROGRAM, "run", source.string(), "--realtime",
        "--fps",         "2",   "--out",         (directory_ / "out").string()};
    for (const auto& [key, value] : options()) command.insert(command.end(), {key, value});
    Process process(command, directory_ / "err", directory_ / "said");
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    while (process.stderrText().empty() && std::chrono::steady_clock::now() < until) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2000));  // of ten seconds
    process.signal(SIGINT);
    EXPECT_EQ(process.wait(std::chrono::seconds(60)), 1) << process.stderrText();
    const nlohmann::json told = statistics();
    EXPECT_TRUE(told["incomplete"].get<std::string>().starts_with("interrupted after "));
    EXPECT_GT(told["localized"].get<int>(), 0);
    EXPECT_LT(told["frames"].get<int>(), 20);
    EXPECT_LE(told["keyframes"].get<int>(), told["frames"].get<int>()) << "each view counts once";
    EXPECT_EQ(poses("trajectory.tum"), told["localized"].get<int>());
  }
}

TEST_F(InterruptedRun, OfAFullDiskThereIsWhatFits) {
  const SmallDisk disk(directory_ / "out", "24k");
  if (!disk) GTEST_SKIP() << "only root can mount a small file system";
  const ProgramResult result = run(images_.string(), options());
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("No space left on device; missing: "), std::string::npos) << result.err;
  EXPECT_NE(statistics()["incomplete"].get<std::string>().find("No space left on device"),
            std::string::npos);
  EXPECT_EQ(poses("trajectory.tum"), statistics()["localized"].get<int>());
}

TEST_F(InterruptedRun, ARecordingOnAFullDiskFails) {
  const SmallDisk disk(directory_ / "recordings", "16k");
  if (!disk) GTEST_SKIP() << "only root can mount a small file system";
  const ProgramResult result =
      waymark({"record", images_.string(), "--out", (directory_ / "recordings").string(),
               "--keep-free-mib", "0", "--quiet"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("the recording is incomplete: 0.0 MiB, 20 frames lost; paused: "),
            std::string::npos)
      << result.err;
  EXPECT_NE(result.err.find("No space left on device"), std::string::npos) << result.err;
  EXPECT_TRUE(fs::is_empty(directory_ / "recordings")) << "no empty file";
}

}  // namespace
}  // namespace waymark::testing
