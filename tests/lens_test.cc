// A lens that nobody has measured, or measured badly, as the users of `waymark` meet it.
#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "io/calibrations/calibration_file.h"
#include "tests/process.h"
#include "tests/temporary_directory.h"

namespace waymark {
namespace {

using nlohmann::json;
using testing::ProgramResult;
using testing::readFile;

ProgramResult waymark(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), WAYMARK_PROGRAM);
  return testing::runProgram(arguments);
}

// Eight seconds of a rendered room, made once for all tests.
class LensTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    directory_ = new testing::TemporaryDirectory();
    simulate("walls", {});
  }
  static void TearDownTestSuite() { delete directory_; }

  static std::string path(const std::string& name) { return *directory_ / name; }

  static void simulate(const std::string& name, const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"simulate", "walls", "--out", path(name), "--duration",
                                          "8",        "--fps", "30",    "--quiet"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    ASSERT_EQ(waymark(arguments).exit_code, 0);
  }

  // calibration: empty for none.
  static ProgramResult run(const std::string& recording, const std::string& calibration,
                           const std::string& out, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"run",           path(recording) + "/frames.avi",
                                          "--dictionary",  "ARUCO_MIP_36h12",
                                          "--marker-size", "0.123",
                                          "--out",         path(out),
                                          "--quiet"};
    if (!calibration.empty()) arguments.insert(arguments.end(), {"--calibration", calibration});
    arguments.insert(arguments.end(), more.begin(), more.end());
    return waymark(arguments);
  }

  static slam::Calibration truth() { return *io::readCalibration(path("walls/calib.yml")); }
  // As nobody would have measured it.
  static std::string wrongCalibration() {
    slam::Calibration wrong = truth();
    wrong.fx *= 0.98;
    wrong.fy *= 0.98;
    wrong.cx += 8.0;
    wrong.distortion[0] -= 0.05;
    EXPECT_TRUE(io::writeCalibration(path("wrong.yml"), wrong));
    return path("wrong.yml");
  }

  static json stats(const std::string& out) {
    return json::parse(readFile(path(out) + "/stats.json"));
  }
  // Mean, millimetres.
  static double error_mm(const std::string& recording, const std::string& out, const char* what) {
    const ProgramResult result =
        waymark({"eval", "--truth", path(recording) + "/gt_traj.txt", "--estimate",
                 path(out) + "/trajectory_final.tum", "--truth-map",
                 path(recording) + "/gt_map.json", "--map", path(out) + "/map.json", "--json"});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return 1e3 * json::parse(result.out)[what]["mean"].get<double>();
  }
  static void expectTrueLens(const std::string& file) {
    const auto found = io::readCalibration(file);
    ASSERT_TRUE(found) << found.error().message;
    const slam::Calibration expected = truth();
    EXPECT_NEAR(found->fx / expected.fx, 1.0, 2e-3);
    EXPECT_NEAR(found->fy / expected.fy, 1.0, 2e-3);
    EXPECT_NEAR(found->cx, expected.cx, 1.5);
    EXPECT_NEAR(found->cy, expected.cy, 1.5);
    EXPECT_NEAR(found->distortion[0], expected.distortion[0], 0.01);
  }

  static testing::TemporaryDirectory* directory_;
};

testing::TemporaryDirectory* LensTest::directory_ = nullptr;

TEST_F(LensTest, ARightCalibrationStaysAsItIs) {
  const ProgramResult result = run("walls", path("walls/calib.yml"), "right");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.err, "");
  EXPECT_EQ(stats("right")["lens"]["state"], "given");
  EXPECT_EQ(*io::readCalibration(path("right/calib.yml")), truth());
}

TEST_F(LensTest, AWrongCalibrationGivesWay) {
  const std::string file = wrongCalibration();
  const std::string before = readFile(file);
  const ProgramResult result = run("walls", file, "wrong");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("wrong.yml does not fit these images"), std::string::npos)
      << result.err;
  const json told = stats("wrong");
  EXPECT_EQ(told["lens"]["state"], "learned");
  EXPECT_EQ(told["counters"]["quarantined_markers"], 0);
  EXPECT_EQ(told["markers"], 48);
  EXPECT_EQ(told["localized"], told["frames"]);
  EXPECT_LT(error_mm("walls", "wrong", "ate_m"), 2.5);
  EXPECT_LT(error_mm("walls", "wrong", "ace_m"), 2.5);
  expectTrueLens(path("wrong/calib.yml"));
  EXPECT_EQ(readFile(file), before) << "what was given is never overwritten";
}

TEST_F(LensTest, NoCalibrationIsNeeded) {
  const ProgramResult result = run("walls", "", "none");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json told = stats("none");
  EXPECT_EQ(told["lens"]["state"], "learned");
  EXPECT_EQ(told["counters"]["quarantined_markers"], 0);
  EXPECT_EQ(told["markers"], 48);
  EXPECT_GE(told["localized"].get<int>(), 0.97 * told["frames"].get<int>());
  EXPECT_LT(error_mm("walls", "none", "ace_m"), 2.5);
  expectTrueLens(path("none/calib.yml"));
}

// Nor of a wide one, whose first squares leave open of which model it is; in a known map, neither.
TEST_F(LensTest, NoCalibrationOfAWideLensIsNeeded) {
  simulate("wide", {"--fisheye", "120", "--seed", "11"});
  const double true_fx = io::readCalibration(path("wide/calib.yml"))->fx;
  ASSERT_EQ(run("wide", "", "wide_none").exit_code, 0);
  EXPECT_GE(stats("wide_none")["localized"].get<int>(), 0.97 * 240);
  EXPECT_NEAR(io::readCalibration(path("wide_none/calib.yml"))->fx / true_fx, 1.0, 2e-3);
  EXPECT_LT(error_mm("wide", "wide_none", "ace_m"), 8.0);

  ASSERT_EQ(
      run("wide", "", "wide_known", {"--map-in", path("wide_none/map.json"), "--localize-only"})
          .exit_code,
      0);
  EXPECT_GE(stats("wide_known")["localized"].get<int>(), 0.8 * 240);
  EXPECT_NEAR(io::readCalibration(path("wide_known/calib.yml"))->fx / true_fx, 1.0, 3e-3);
}

TEST_F(LensTest, TheSameAgainToTheByte) {
  ASSERT_EQ(run("walls", "", "once").exit_code, 0);
  ASSERT_EQ(run("walls", "", "again").exit_code, 0);
  for (const char* name : {"/trajectory.tum", "/trajectory_final.tum", "/map.json", "/calib.yml"}) {
    EXPECT_EQ(readFile(path("once") + name), readFile(path("again") + name)) << name;
  }
}

// The map is somebody else's, and stays as it is.
TEST_F(LensTest, IsLearnedInAKnownMap) {
  ASSERT_EQ(run("walls", path("walls/calib.yml"), "known").exit_code, 0);
  const ProgramResult result = run("walls", wrongCalibration(), "localized",
                                   {"--map-in", path("known/map.json"), "--localize-only"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(readFile(path("known/map.json")), readFile(path("localized/map.json")));
  EXPECT_NE(stats("localized")["lens"]["state"], "given");
  expectTrueLens(path("localized/calib.yml"));
  EXPECT_LT(error_mm("walls", "localized", "ate_m"), 5.0);
}

TEST_F(LensTest, AChangeOfFocusIsNoticed) {
  simulate("refocused", {"--refocus", "5:1.03"});
  const ProgramResult result = run("refocused", path("walls/calib.yml"), "changed");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("the lens changed under way"), std::string::npos) << result.err;
  const auto found = io::readCalibration(path("changed/calib.yml"));
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->fx / truth().fx, 1.03, 3e-3);
  EXPECT_EQ(stats("changed")["counters"]["quarantined_markers"], 0);
  ASSERT_EQ(stats("changed")["lens"]["changed_at_s"].size(), 1U);
  EXPECT_NEAR(stats("changed")["lens"]["changed_at_s"][0].get<double>(), 5.0, 0.5);
}

TEST_F(LensTest, BelievesAnyCalibrationWhereLearningIsOff) {
  const std::string config = path("off.toml");
  {
    std::ofstream(config) << "[camera]\nlearn = false\n[slam]\ndictionary = \"ARUCO_MIP_36h12\"\n";
  }
  const ProgramResult result = run("walls", wrongCalibration(), "off", {"--config", config});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(stats("off")["lens"]["state"], "given");
  const ProgramResult without = run("walls", "", "neither", {"--config", config});
  EXPECT_EQ(without.exit_code, 2);
  EXPECT_NE(without.err.find("--calibration: required"), std::string::npos) << without.err;
}

}  // namespace
}  // namespace waymark
