// The `waymark` command as its users meet it: exit codes, messages and files.
#include "tests/waymark_tool.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sys/stat.h>

#include "io/calibrations/calibration_file.h"
#include "tests/process.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;

TEST_F(WaymarkTool, HelpAndVersion) {
  for (const char* option : {"--help", "--version"}) {
    const ProgramResult result = waymark({option});
    EXPECT_EQ(result.exit_code, 0);
    EXPECT_NE(result.out, "");
    EXPECT_EQ(result.err, "");
  }
  EXPECT_NE(waymark({"run", "--help"}).out.find("--marker-size"), std::string::npos);
}

TEST_F(WaymarkTool, BadUsageIsOneLine) {
  expectBadInput(waymark({}), "subcommand");
  expectBadInput(waymark({"fly"}), "'fly' is no command of waymark; there are setup, run, ");
  expectBadInput(waymark({"ctl"}), "subcommand");
  expectBadInput(waymark({"ctl", "nonsense"}),
                 "'nonsense' is no command of ctl; there are status, ");
  expectBadInput(waymark({"run"}), "source is required");
  expectBadInput(waymark({"run", "--unknown"}), "");
  expectBadInput(run(video(), {{"--fps", "-3"}}), "--fps");
  expectBadInput(run(video(), {{"--fps", "fast"}}), "--fps");
}

TEST_F(WaymarkTool, WhatWasProbablyMeant) {
  expectBadInput(waymark({"calibrat"}),
                 "'calibrat' is no command of waymark; did you mean "
                 "calibrate? There are setup, run, ");
  expectBadInput(waymark({"ctl", "statsu"}), "'statsu' is no command of ctl; did you mean status?");
  expectBadInput(waymark({"run", "a.avi", "--dictonary", "4X4_50"}),
                 "'--dictonary' is no option of run; did you mean --dictionary?");
  expectBadInput(waymark({"run", "a.avi", "--qwertyuiop=3"}),
                 "'--qwertyuiop' is no option of run; --help lists them");
  const auto meant = [&](const char* name, const char* family) {
    expectBadInput(
        run(video(), {{"--dictionary", name}}),
        std::string(name) + "\" is not a known dictionary; did you mean " + family + "?");
  };
  meant("tag36h11", "APRILTAG_36h11");
  meant("DICT_4X4_50", "4X4_50");
  meant("aruco_mip_36h12", "ARUCO_MIP_36h12");
  meant("DICT_APRILTAG_16H5", "APRILTAG_16h5");
  meant("APRILTAG_36H12", "APRILTAG_36h11");
  std::ofstream(directory_ / "w.toml") << "[slam]\ndictonary = '4X4_50'\n";
  expectBadInput(run(video(), {{"--config", (directory_ / "w.toml").string()}}),
                 "slam.dictonary: unknown key; did you mean slam.dictionary?");
}

TEST_F(WaymarkTool, NumbersInMessagesAreShort) {
  for (const std::vector<std::string>& bad :
       std::vector<std::vector<std::string>>{{"echo", "--count", "0"},
                                             {"echo", "--count", "-3"},
                                             {"run", video(), "--origin-marker", "-1"},
                                             {"record", "v4l2:0", "--out", "o", "--exposure", "0"},
                                             {"record", "v4l2:0", "--out", "o", "--width", "0"},
                                             {"eval", "--limit-frames", "0"},
                                             {"print", "--marker-size", "-1"},
                                             {"ctl", "--timeout", "0", "status"}}) {
    const ProgramResult result = waymark(bad);
    EXPECT_EQ(result.exit_code, 2) << result.err;
    EXPECT_LT(result.err.size(), 120U) << result.err;
  }
  expectBadInput(run(video(), {{"--marker-size", "123"}}),
                 "must be a number of metres, from 0.001 to 100; 123 mm are 0.123");
}

TEST_F(WaymarkTool, NumbersThatAreNone) {
  expectBadInput(run(video(), {{"--fps", "1e-300"}}), "--fps: '1e-300' must be a number from ");
  expectBadInput(run(video(), {{"--fps", "nan"}}), "--fps");
  expectBadInput(waymark({"echo", "--interval", "nan"}), "--interval");
  expectBadInput(waymark({"echo", "--duration", "nan"}), "--duration");
  expectBadInput(waymark({"record", "v4l2:0", "--duration", "nan"}), "--duration");
  expectBadInput(waymark({"eval", "--tolerance", "nan"}), "--tolerance");
  expectBadInput(waymark({"map", "merge", "a", "b", "c", "--tolerance", "nan"}), "--tolerance");
}

TEST_F(WaymarkTool, AnOriginMarkerThatIsNeverSeenIsToldOf) {
  expectBadInput(run(video(), {{"--origin-marker", "5000"}}),
                 "the origin marker 5000 is not in ARUCO_ORIGINAL");
  EXPECT_EQ(run(video()).err.find("origin"), std::string::npos);
  const std::string told = run(video(), {{"--origin-marker", "7"}}).err;
  EXPECT_NE(
      told.find("waymark: warning: the origin marker 7 was never placed; the world is another"),
      std::string::npos)
      << told;
}

TEST_F(WaymarkTool, FifosAreNoInput) {
  const fs::path fifo = directory_ / "fifo.avi";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  expectBadInput(run(fifo.string()), "fifo.avi: is neither a file nor a directory");
  expectBadInput(run(video(), {{"--calibration", fifo.string()}}), "fifo.avi: is a FIFO");
}

TEST_F(WaymarkTool, BadVideos) {
  expectBadInput(run((directory_ / "missing.avi").string()), "missing.avi: no such file");
  expectBadInput(run((directory_ / "calib.yml").string()), "calib.yml: is not a video");
  const std::string bytes = readFile(video());
  const std::size_t kept = (bytes.find("movi") + bytes.rfind("idx1")) / 2;  // half the frames
  std::ofstream(directory_ / "cut.avi", std::ios::binary) << bytes.substr(0, kept);
  const ProgramResult cut = run((directory_ / "cut.avi").string());
  expectBadInput(cut, "cut.avi: frame ");
  expectBadInput(cut, "the recording ends here, but its header promises 8 frames");
  expectBadInput(run("thermal:0"), "thermal:0: unknown kind of source");
}

TEST_F(WaymarkTool, ImagesOfMixedSizes) {
  const fs::path images = directory_ / "images";
  fs::create_directory(images);
  cv::imwrite((images / "1.png").string(),
              cv::Mat(kToolHeight, kToolWidth, CV_8UC1, cv::Scalar(9)));
  cv::imwrite((images / "2.png").string(), cv::Mat(48, 64, CV_8UC1, cv::Scalar(9)));
  expectBadInput(run(images.string()), "2.png: is 64x48, the images before are 160x120");
}

TEST_F(WaymarkTool, BadCalibrations) {
  expectBadInput(run(video(), {{"--calibration", "/nonexistent.yml"}}), "/nonexistent.yml: ");
  std::ofstream(directory_ / "half.yml") << "%YAML:1.0\n---\nimage_width: 160\n";
  expectBadInput(run(video(), {{"--calibration", (directory_ / "half.yml").string()}}),
                 "half.yml: image_height: is missing");
  const slam::Calibration other{
      .width = 640, .height = 480, .fx = 500.0, .fy = 500.0, .cx = 320.0, .cy = 240.0};
  ASSERT_TRUE(io::writeCalibration(directory_ / "other.yml", other).ok());
  expectBadInput(run(video(), {{"--calibration", (directory_ / "other.yml").string()}}),
                 ": the pictures are 160x120, but the calibration is for ");
}

TEST_F(WaymarkTool, BadMarkers) {
  expectBadInput(run(video(), {{"--dictionary", "APRILTAG_99"}}),
                 "--dictionary: \"APRILTAG_99\" is not a known dictionary; known are 4X4_100");
  for (const char* size : {"0", "-0.1", "big", "5cm", "nan", "inf", "1e9"}) {
    expectBadInput(run(video(), {{"--marker-size", size}}), "--marker-size");
  }
}

// The options that `run` cannot do without come from the file or the command line, which wins.
TEST_F(WaymarkTool, ConfigurationFile) {
  const std::string config = (directory_ / "w.toml").string();
  const auto runWith = [&](const std::string& text, std::vector<std::string> options = {}) {
    std::ofstream(config) << text;
    options.insert(options.begin(), {"run", video(), "--config", config, "--calibration",
                                     (directory_ / "calib.yml").string()});
    return waymark(options);
  };
  const std::string slam = "[slam]\ndictionary = '4X4_50'\nmarker_size_m = 0.1\n";
  EXPECT_EQ(runWith("[camera]\nsource = 'sim:walls'\n" + slam).exit_code, 3);
  EXPECT_EQ(runWith("[slam]\nmarker_size_m = 0.1\n", {"--dictionary", "4X4_50"}).exit_code, 3);
  expectBadInput(runWith(slam, {"--dictionary", "5X5"}), "--dictionary: \"5X5\"");
  expectBadInput(runWith(slam, {"--marker-size", "0"}), "--marker-size: '0'");
  expectBadInput(runWith("[slam]\nmarker_size_m = 0.1\n"),
                 "--dictionary is required here or in " + config);
  expectBadInput(runWith("[slam]\ndictionary = '4X4_50'\n"), "--marker-size is required");
  expectBadInput(runWith(slam + "colour = 1\n"), "w.toml:4:1: slam.colour: unknown key");
  expectBadInput(runWith("[slam\n"), "w.toml:1:");
  expectBadInput(runWith(slam + "[slam.detector]\nscanner.quads.min_side_px = 'large'\n"),
                 "w.toml:5:29: slam.detector.scanner.quads.min_side_px: must be a number");
  // Each value is right by itself.
  const std::string anchor =
      "[[slam.markers.anchors]]\nid = 1\np_m = [0, 0, 0]\nq_wxyz = [1, 0, 0, 0]\n";
  expectBadInput(runWith(slam + "[slam.markers]\norigin = 2\n" + anchor),
                 "w.toml: slam: anchors and an origin marker both fix the world");
  expectBadInput(runWith(slam + "[slam.markers]\nignored = '0-3'\n" + anchor),
                 "w.toml: slam: anchor 1 is among the ignored ids");
  expectBadInput(waymark({"run", video(), "--config", "/nowhere.toml", "--calibration", "c.yml"}),
                 "/nowhere.toml: cannot be read");
}

TEST_F(WaymarkTool, OutputsThatCannotBeWritten) {
  expectBadInput(run(video(), {{"--out", video() + "/below"}}), "output directory cannot be made");
  expectBadInput(run(video(), {{"--out", video()}}), "output directory cannot be made");
  expectBadInput(run(video(), {{"--out", "/proc/waymark"}}), "output directory cannot be made");
}

TEST_F(WaymarkTool, BadDetections) {
  std::ofstream(directory_ / "detections.csv") << "1.0,4,0,1,2\n";
  expectBadInput(run((directory_ / "detections.csv").string()), "detections.csv:1: has 5 fields");
}

TEST_F(WaymarkTool, NoMarkerAnywhereIsExitCodeThree) {
  const ProgramResult result = run(video());
  EXPECT_EQ(result.exit_code, 3) << result.err;
  const nlohmann::json statistics =
      nlohmann::json::parse(readFile(directory_ / "out" / "stats.json"));
  EXPECT_EQ(statistics["frames"], 8);
  EXPECT_EQ(statistics["localized"], 0);
  EXPECT_TRUE(statistics["initialized_at_frame"].is_null());
  EXPECT_EQ(statistics["verdict"]["grade"], "none");
  EXPECT_NE(result.out.find("verdict: no pose in 8 frames\n"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("  - there is no dark square in any frame"), std::string::npos);
  EXPECT_NE(result.out.find("  - the images show nothing"), std::string::npos);
  // Who wants to hear errors only hears this one.
  const ProgramResult quiet =
      waymark({"run", video(), "--calibration", (directory_ / "calib.yml").string(), "--dictionary",
               "ARUCO_ORIGINAL", "--marker-size", "0.05", "--quiet"});
  EXPECT_EQ(quiet.exit_code, 3);
  EXPECT_EQ(quiet.out, "");
  EXPECT_TRUE(quiet.err.starts_with("verdict: no pose in 8 frames\n")) << quiet.err;
}

TEST_F(WaymarkTool, BadTrajectories) {
  std::ofstream(directory_ / "good.tum") << "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n";
  std::ofstream(directory_ / "bad.tum") << "1 0 0 0 0 0 0 1\n2 1 0\n";
  std::ofstream(directory_ / "late.tum") << "100 0 0 0 0 0 0 1\n";
  const std::string good = (directory_ / "good.tum").string();
  const auto eval = [&](const std::string& estimate) {
    return waymark({"eval", "--truth", good, "--estimate", (directory_ / estimate).string()});
  };
  expectBadInput(eval("missing.tum"), "missing.tum: cannot be read");
  expectBadInput(eval("bad.tum"), "bad.tum:2: has 3 fields");
  expectBadInput(eval("late.tum"), "late.tum: no pose of the estimate is within");
  EXPECT_EQ(eval("good.tum").exit_code, 0);
}

TEST_F(WaymarkTool, EvalNeedsWhatItMeasures) {
  std::ofstream(directory_ / "a.tum") << "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n";
  const std::string tum = (directory_ / "a.tum").string();
  const auto eval = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "eval");
    return waymark(arguments);
  };
  expectBadInput(eval({"--truth", tum}), "nothing to measure");
  expectBadInput(eval({"--estimate", tum}), "--estimate needs --truth");
  expectBadInput(eval({"--map", "m.json"}), "--map needs --truth-map");
  expectBadInput(eval({"--limit", "d.csv", "--truth", tum}), "--limit needs --truth, --truth-map");
  expectBadInput(eval({"--truth", tum, "--estimate", tum, "--visible", "v.csv"}),
                 "--visible needs --map and --estimate");
  expectBadInput(eval({"--truth", tum, "--estimate", tum, "--skip", "3"}), "--skip: '3' is not");
  expectBadInput(eval({"--truth", tum, "--estimate", tum, "--skip", "3:2"}), "--skip: '3:2' is");
  expectBadInput(eval({"--truth", tum, "--estimate", tum, "--skip", "0:9"}), "a.tum: no pose");
  expectBadInput(eval({"--truth", tum, "--estimate", tum, "--limit-frames", "0"}),
                 "--limit-frames");
}

TEST_F(WaymarkTool, DetectionsThatCannotBeSaved) {
  const auto save = [&](const std::string& file) {
    return run(video(), {{"--save-detections", file}});
  };
  expectBadInput(save((directory_ / "corners.txt").string()), "--save-detections: '");
  expectBadInput(save((directory_ / "frames.csv").string()), "--save-detections: '");
  expectBadInput(save(video() + "/corners.csv"), "output directory cannot be made");
  std::ofstream(directory_ / "frames.csv") << "1\n";
  expectBadInput(save((directory_ / "corners.csv").string()), "frames.csv: exists already");
}

// A rendered walk: its corners on file give the map and the trajectory that the images gave, and
// `eval` finds both near the limit of these corners.
TEST_F(WaymarkTool, SavedDetectionsReplayAsTheImages) {
  const fs::path walk = directory_ / "walk";
  ASSERT_EQ(waymark({"simulate", "walls", "--duration", "8", "--fps", "10", "--quiet", "--out",
                     walk.string()})
                .exit_code,
            0);
  const std::string detections = (directory_ / "corners" / "detections.csv").string();
  // Corners are all that is saved, and natural features have their say in a pose of few markers.
  const fs::path markers_only = directory_ / "markers_only.toml";
  std::ofstream(markers_only) << "[slam]\nnatural.enabled = false\n";
  const auto runInto = [&](const std::string& source, const char* out) {
    return run(source, {{"--calibration", (walk / "calib.yml").string()},
                        {"--config", markers_only.string()},
                        {"--dictionary", "ARUCO_MIP_36h12"},
                        {"--marker-size", "0.123"},
                        {"--save-detections", detections},
                        {"--out", (directory_ / out).string()}});
  };
  ASSERT_EQ(runInto((walk / "frames.avi").string(), "images").exit_code, 0);
  const std::string saved = readFile(detections);
  const ProgramResult replay = runInto(detections, "replay");
  ASSERT_EQ(replay.exit_code, 0) << replay.err;
  const std::string again = readFile(detections);
  EXPECT_GT(std::count(saved.begin(), saved.end(), '\n'), 200);
  EXPECT_EQ(std::count(saved.begin(), saved.end(), '\n'),
            std::count(again.begin(), again.end(), '\n'));

  const auto file = [&](const char* out, const char* name) {
    return (directory_ / out / name).string();
  };
  for (const char* trajectory : {"trajectory.tum", "trajectory_final.tum"}) {
    const ProgramResult eval = waymark(
        {"eval", "--truth", file("images", trajectory), "--estimate", file("replay", trajectory),
         "--truth-map", file("images", "map.json"), "--map", file("replay", "map.json"), "--json"});
    ASSERT_EQ(eval.exit_code, 0) << eval.err;
    const nlohmann::json same = nlohmann::json::parse(eval.out);
    EXPECT_EQ(same["matched"], same["truth_poses"]);
    EXPECT_EQ(same["missing_markers"].size() + same["unknown_markers"].size(), 0U);
    EXPECT_LT(same["ate_m"]["max"].get<double>(), 1e-7);
    EXPECT_LT(same["ace_m"]["max"].get<double>(), 1e-7);
  }

  const ProgramResult eval =
      waymark({"eval", "--truth", file("walk", "gt_traj.txt"), "--estimate",
               file("images", "trajectory_final.tum"), "--truth-map", file("walk", "gt_map.json"),
               "--map", file("images", "map.json"), "--visible", file("walk", "gt_visible.csv"),
               "--limit", detections, "--calibration", file("walk", "calib.yml"), "--json"});
  ASSERT_EQ(eval.exit_code, 0) << eval.err;
  const nlohmann::json errors = nlohmann::json::parse(eval.out);
  EXPECT_EQ(errors["in_view"]["localised"], errors["in_view"]["frames"]);
  EXPECT_GT(errors["in_view"]["frames"].get<int>(), 70);
  EXPECT_EQ(errors["limit"]["frames"], 80);
  EXPECT_LT(errors["limit"]["corner_rms_px"].get<double>(), 0.1);
  EXPECT_LT(errors["limit"]["ate_m"]["mean"].get<double>(), 0.002);
  EXPECT_LT(errors["ate_m"]["mean"].get<double>(),
            2.0 * errors["limit"]["ate_m"]["mean"].get<double>());
}

// On a real recording: every file, twice the same bytes, and close to the printed board.
TEST_F(WaymarkTool, RealRecordingTwice) {
  const char* data = std::getenv("WAYMARK_SHARED_DATA");
  if (data == nullptr || !fs::exists(data)) GTEST_SKIP() << "no real recordings here";
  const fs::path folder = fs::path(data) / "aruco_chess18";
  for (const char* out : {"first", "second"}) {
    const ProgramResult result =
        run((folder / "frames.avi").string(), {{"--calibration", (folder / "calib.yml").string()},
                                               {"--marker-size", "0.034"},
                                               {"--out", (directory_ / out).string()}});
    ASSERT_EQ(result.exit_code, 0) << result.err;
  }
  for (const char* file : {"trajectory.tum", "trajectory_final.tum", "poses.csv", "poses_final.csv",
                           "map.json", "map.svg"}) {
    const std::string bytes = readFile(directory_ / "first" / file);
    EXPECT_FALSE(bytes.empty()) << file;
    EXPECT_TRUE(bytes == readFile(directory_ / "second" / file)) << file << " differs";
  }
  const nlohmann::json statistics =
      nlohmann::json::parse(readFile(directory_ / "first" / "stats.json"));
  EXPECT_EQ(statistics["frames"], 149);
  EXPECT_GE(statistics["localized"].get<int>(), 143);  // 97 % of the 147 with a marker
  for (const char* stage : {"total", "detect", "track", "map"}) {
    for (const char* clock : {"wall_ms", "cpu_ms"}) {
      for (const char* value : {"mean", "median", "p99", "p999", "max"}) {
        EXPECT_TRUE(statistics["timing"][stage][clock][value].is_number()) << stage << value;
      }
    }
  }
  const std::string trajectory = (directory_ / "first" / "trajectory_final.tum").string();
  const ProgramResult eval = waymark({"eval", "--truth", trajectory, "--estimate", trajectory,
                                      "--truth-map", (folder / "gt_map.json").string(), "--map",
                                      (directory_ / "first" / "map.json").string(), "--json"});
  ASSERT_EQ(eval.exit_code, 0) << eval.err;
  const nlohmann::json errors = nlohmann::json::parse(eval.out);
  EXPECT_EQ(errors["common_markers"], 18);
  EXPECT_LT(errors["ace_m"]["mean"].get<double>(), 0.001);
}

}  // namespace
}  // namespace waymark::testing
