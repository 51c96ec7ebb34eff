// Maps from run to run, to other programs and back, as the users of `waymark` do it.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "io/calibrations/calibration_file.h"
#include "io/maps/map_file.h"
#include "io/trajectory.h"
#include "tests/process.h"
#include "tests/synthetic_recording.h"
#include "tests/temporary_directory.h"

namespace waymark {
namespace {

namespace fs = std::filesystem;
using testing::MarkerWall;
using testing::ProgramResult;
using testing::readFile;

ProgramResult waymark(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), WAYMARK_PROGRAM);
  return testing::runProgram(arguments);
}

// The wall, recorded from left to middle, from middle to right, and the calibration of it.
class MapLife : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(io::writeCalibration(path("calib.yml"), calibration_).ok());
    testing::recordWall(wall_, calibration_, -3.0, 0.3, path("left"));
    testing::recordWall(wall_, calibration_, -0.3, 3.0, path("right"));
  }

  [[nodiscard]] std::string path(const std::string& name) const { return directory_ / name; }

  // `waymark run` over one of the recordings, into the directory `out`.
  ProgramResult run(const std::string& recording, const std::string& out,
                    const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"run",           path(recording) + "/detections.csv",
                                          "--dictionary",  "4X4_50",
                                          "--marker-size", "0.2",
                                          "--calibration", path("calib.yml"),
                                          "--out",         path(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return waymark(arguments);
  }

  io::MapFile readMap(const std::string& name) {
    Result<io::MapFile> file = io::readMap(path(name));
    EXPECT_TRUE(file) << file.error().message;
    return file ? std::move(file).value() : io::MapFile();
  }

  [[nodiscard]] std::vector<int> posedIds(const std::string& name) {
    std::vector<int> ids;
    const slam::Map map = readMap(name).map;
    for (const auto& [id, marker] : map.markers()) {
      if (marker.T_w_m) ids.push_back(id);
    }
    return ids;
  }

  // Both halves of the wall, one after the other, with nothing between that connects the two.
  void recordApart(const std::string& name) const {
    fs::create_directories(path(name));
    std::ofstream detections(path(name) + "/detections.csv");
    std::ofstream frames(path(name) + "/frames.csv");
    for (const bool right : {false, true}) {
      MarkerWall half = wall_;
      std::erase_if(half.markers, [&](const auto& marker) {
        return (marker.id % MarkerWall::kColumns >= MarkerWall::kColumns / 2) != right;
      });
      const double side = right ? 1.0 : -1.0;
      testing::recordWall(half, calibration_, 2.6 * side, 1.6 * side, path("half"));
      detections << later(readFile(path("half") + "/detections.csv"), right ? kPause_s : 0);
      frames << later(readFile(path("half") + "/frames.csv"), right ? kPause_s : 0);
    }
  }
  static constexpr int kPause_s = 5;

  // Lines that begin with seconds.
  static std::string later(const std::string& lines, int seconds) {
    std::istringstream in(lines);
    std::ostringstream out;
    out.precision(12);
    std::string line;
    while (std::getline(in, line)) {
      const std::size_t end = std::min(line.find(','), line.size());
      out << std::stod(line) + seconds << line.substr(end) << "\n";
    }
    return out.str();
  }

  // How far apart the distances between markers are from the true ones, at worst, metres.
  [[nodiscard]] double worstDistance(const slam::Map& map) const {
    double worst = 0.0;
    for (const auto& [i, a] : map.markers()) {
      for (const auto& [j, b] : map.markers()) {
        if (!a.T_w_m || !b.T_w_m) continue;
        const double expected = (wall_.markers[static_cast<std::size_t>(i)].T_w_m.p -
                                 wall_.markers[static_cast<std::size_t>(j)].T_w_m.p)
                                    .norm();
        worst = std::max(worst, std::abs((a.T_w_m->p - b.T_w_m->p).norm() - expected));
      }
    }
    return worst;
  }

  // What stands in that column of a poses.csv.
  static std::set<std::string> piecesIn(const std::string& file) {
    std::istringstream lines(readFile(file));
    std::string line;
    std::getline(lines, line);
    const auto column = std::count(line.begin(), line.begin() + line.find(",piece"), ',') + 1;
    std::set<std::string> pieces;
    while (std::getline(lines, line)) {
      std::istringstream fields(line);
      std::string field;
      for (auto i = 0; i <= column; ++i) std::getline(fields, field, ',');
      if (!field.empty()) pieces.insert(field);
    }
    return pieces;
  }

  static int localized(const std::string& directory) {
    return nlohmann::json::parse(readFile(fs::path(directory) / "stats.json"))["localized"];
  }

  // Exit code 2, one line that contains `complaint`.
  static void expectBadInput(const ProgramResult& result, const std::string& complaint) {
    EXPECT_EQ(result.exit_code, 2) << result.err;
    EXPECT_NE(result.err.find(complaint), std::string::npos) << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_EQ(result.out, "");
  }

  const testing::TemporaryDirectory directory_;
  const slam::Calibration calibration_ = slam::testing::testCalibration();
  const MarkerWall wall_;
};

TEST_F(MapLife, GoesOnWithAnOldMap) {
  ASSERT_EQ(run("left", "a").exit_code, 0);
  const std::size_t before = readMap("a/map.json").map.markers().size();
  EXPECT_LT(before, 48U);
  const ProgramResult result = run("right", "b", {"--map-in", path("a/map.json")});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const slam::Map map = readMap("b/map.json").map;
  EXPECT_GT(map.markers().size(), before);
  EXPECT_EQ(io::posedMarkerCorners(map).size(), 48U);
  EXPECT_LT(worstDistance(map), 0.02);
  EXPECT_EQ(localized(path("b")), 60);
}

TEST_F(MapLife, LocalizesAndChangesNothing) {
  ASSERT_EQ(run("left", "a").exit_code, 0);
  const std::string before = readFile(path("a/map.json"));
  const ProgramResult result =
      run("right", "b", {"--map-in", path("a/map.json"), "--localize-only"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(readFile(path("a/map.json")), before);
  EXPECT_TRUE(readFile(path("b/map.json")) == before);
  EXPECT_GT(localized(path("b")), 40);
}

TEST_F(MapLife, AnyCameraLocalizes) {
  ASSERT_EQ(run("left", "a").exit_code, 0);
  slam::Calibration other = calibration_;
  other.fx = other.fy = 700.0;
  ASSERT_TRUE(io::writeCalibration(path("other.yml"), other).ok());
  testing::recordWall(wall_, other, -3.0, 0.3, path("zoomed"));
  const std::vector<std::string> with_other = {"--calibration", path("other.yml"), "--map-in",
                                               path("a/map.json")};
  const auto runZoomed = [&](const std::string& out, bool localize_only) {
    std::vector<std::string> arguments = {"run",           path("zoomed/detections.csv"),
                                          "--dictionary",  "4X4_50",
                                          "--marker-size", "0.2",
                                          "--out",         path(out)};
    arguments.insert(arguments.end(), with_other.begin(), with_other.end());
    if (localize_only) arguments.push_back("--localize-only");
    return waymark(arguments);
  };
  expectBadInput(runZoomed("b", false), "map.json: camera: is another one, or badly calibrated");
  EXPECT_FALSE(fs::exists(path("b")));
  EXPECT_EQ(runZoomed("c", true).exit_code, 0);
  EXPECT_GT(localized(path("c")), 55);
}

TEST_F(MapLife, ImprovesTheCalibration) {
  slam::Calibration wrong = calibration_;
  wrong.fx += 4.0;
  wrong.cx -= 3.0;
  ASSERT_TRUE(io::writeCalibration(path("calib.yml"), wrong).ok());
  const ProgramResult result = run("left", "a", {"--refine-intrinsics"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const Result<slam::Calibration> better = io::readCalibration(path("a/calib.yml"));
  ASSERT_TRUE(better) << better.error().message;
  EXPECT_LT(std::abs(better->fx - calibration_.fx), 2.0);
  EXPECT_LT(std::abs(better->cx - calibration_.cx), 2.0);
  EXPECT_EQ(readMap("a/map.json").camera->fx, better->fx);
  // The markers have contradicted that calibration: the next start with it goes on with theirs.
  EXPECT_NE(result.err.find("calib.yml does not fit these images"), std::string::npos)
      << result.err;
  const ProgramResult again = run("right", "b", {"--map-in", path("a/map.json"), "--quiet"});
  EXPECT_EQ(again.exit_code, 0);
  EXPECT_NE(again.err.find("a/map.json: camera: going on with the lens as the map has learned it"),
            std::string::npos)
      << again.err;
}

TEST_F(MapLife, BadMaps) {
  ASSERT_EQ(run("left", "a").exit_code, 0);
  const std::string map = path("a/map.json");
  const std::string text = readFile(map);
  const auto runWith = [&](const std::string& content, std::vector<std::string> more = {}) {
    std::ofstream(path("bad.json")) << content;
    more.insert(more.begin(), {"--map-in", path("bad.json")});
    return run("left", "b", more);
  };
  expectBadInput(runWith(text.substr(0, text.size() / 2)), "is not JSON: it is cut off here");
  std::string edited = text;
  edited.replace(edited.find("\"size\":0.2"), 10, "\"size\":0.3");
  expectBadInput(runWith(edited), "bad.json: checksum: does not match");
  expectBadInput(runWith("{}"), "bad.json: format: is missing");
  expectBadInput(runWith(text, {"--sizes", "3=0.1"}),
                 "bad.json: markers: marker 3 has a side of 0.2 m there, but 0.1 m here");
  expectBadInput(run("left", "b", {"--map-in", path("none.json")}), "none.json: cannot be read");
  expectBadInput(run("left", "b", {"--localize-only"}), "--localize-only requires --map-in");
  expectBadInput(run("left", "b", {"--refine-intrinsics", "--no-global"}), "excludes");
  expectBadInput(run("left", "b", {"--map-in", map, "--localize-only", "--refine-intrinsics"}),
                 "excludes");
  EXPECT_FALSE(fs::exists(path("b")));
}

TEST_F(MapLife, MarkerOptions) {
  ASSERT_EQ(run("left", "a", {"--origin-marker", "5", "--ignore", "2,16-18"}).exit_code, 0);
  const slam::Map map = readMap("a/map.json").map;
  EXPECT_LT(map.find(5)->T_w_m->p.norm(), 1e-9);
  EXPECT_LT((map.find(5)->T_w_m->R - Eigen::Matrix3d::Identity()).norm(), 1e-9);
  for (const int id : {2, 16, 17, 18}) EXPECT_EQ(map.find(id), nullptr);
  expectBadInput(run("left", "b", {"--ignore", "2-x"}), "--ignore: '2-x' must be an id or a range");
  expectBadInput(run("left", "b", {"--sizes", "2"}), "--sizes: '2' must be ids and a size");
  expectBadInput(run("left", "b", {"--origin-marker", "2", "--ignore", "2"}),
                 "the origin marker is among the ignored ids");
}

TEST_F(MapLife, Anchors) {
  // In the wall's own world, in which the run does not begin.
  std::ofstream toml(path("w.toml"));
  toml.precision(17);
  for (const std::size_t id : {3U, 8U, 22U}) {
    const slam::Transform& T = wall_.markers[id].T_w_m;
    const Eigen::Quaterniond q = T.quaternion();
    toml << "[[slam.markers.anchors]]\nid = " << id << "\np_m = [" << T.p.x() << ", " << T.p.y()
         << ", " << T.p.z() << "]\nq_wxyz = [" << q.w() << ", " << q.x() << ", " << q.y() << ", "
         << q.z() << "]\n";
  }
  toml.close();
  const ProgramResult result = run("left", "a", {"--config", path("w.toml")});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const slam::Map map = readMap("a/map.json").map;
  for (const auto& [id, marker] : map.markers()) {
    if (!marker.T_w_m) continue;
    const Eigen::Vector3d& expected = wall_.markers[static_cast<std::size_t>(id)].T_w_m.p;
    EXPECT_LT((marker.T_w_m->p - expected).norm(), 0.01) << id;
  }
}

TEST_F(MapLife, Info) {
  ASSERT_EQ(run("left", "a").exit_code, 0);
  const ProgramResult result = waymark({"map", "info", path("a/map.json"), "--markers"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("dictionary  4X4_50\n"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("checksum    right\n"), std::string::npos);
  expectBadInput(waymark({"map", "info", path("calib.yml")}), "calib.yml:1:1: is not JSON");
  expectBadInput(waymark({"map"}), "subcommand");
}

// What nothing connects are pieces, each with a world of its own, in every file of the results.
TEST_F(MapLife, APlaceThatNothingConnectsIsAPieceOfItsOwn) {
  recordApart("apart");
  const ProgramResult result = run("apart", "a");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const io::MapFile map = readMap("a/map.json");
  ASSERT_EQ(map.other_pieces.size(), 1U);
  const int other = map.other_pieces.front().piece;
  EXPECT_NE(map.map.piece, other);
  for (const slam::Map* const piece : {&map.map, &map.other_pieces.front()}) {
    EXPECT_EQ(io::posedMarkerCorners(*piece).size(), 24U);
    EXPECT_LT(worstDistance(*piece), 0.02);
  }
  // A file of poses for each, and one of all with the number.
  for (const std::string name : {"trajectory", "trajectory_final"}) {
    const auto main = io::readTrajectory(path("a/" + name + ".tum"));
    const auto more = io::readTrajectory(path("a/" + name + "_" + std::to_string(other) + ".tum"));
    ASSERT_TRUE(main && more) << name;
    EXPECT_GT(main->size(), 50U);
    EXPECT_GT(more->size(), 50U);
    const bool main_came_first = map.map.piece < other;
    const io::Trajectory& first = main_came_first ? *main : *more;
    const io::Trajectory& second = main_came_first ? *more : *main;
    EXPECT_LT(first.back().time_ns, second.front().time_ns);
  }
  for (const std::string name : {"a/poses.csv", "a/poses_final.csv"}) {
    EXPECT_EQ(piecesIn(path(name)),
              (std::set<std::string>{std::to_string(map.map.piece), std::to_string(other)}));
  }
  // Which the picture, `map info` and `eval` tell apart.
  const std::string svg = readFile(path("a/map.svg"));
  const std::string info = waymark({"map", "info", path("a/map.json")}).out;
  std::vector<io::MarkerCorners> truth;
  for (const auto& marker : wall_.markers) {
    io::MarkerCorners corners{marker.id, MarkerWall::kSize_m,
                              slam::markerCorners(MarkerWall::kSize_m)};
    for (Eigen::Vector3d& corner : corners.corners) corner = marker.T_w_m * corner;
    truth.push_back(corners);
  }
  ASSERT_TRUE(io::writeMarkerLayout(path("truth.json"), truth, "").ok());
  const std::string evaluated =
      waymark({"eval", "--map", path("a/map.json"), "--truth-map", path("truth.json")}).out;
  EXPECT_NE(evaluated.find("48 markers in both maps, of 2 pieces"), std::string::npos) << evaluated;
  for (const int piece : {map.map.piece, other}) {
    const std::string name = "piece " + std::to_string(piece);
    EXPECT_NE(svg.find(">" + name + "<"), std::string::npos);
    EXPECT_NE(info.find(name + ", a world of its own\n"), std::string::npos) << info;
    EXPECT_NE(evaluated.find(name + ": 24 markers, ACE mean "), std::string::npos) << evaluated;
  }
}

// Out in each format, in again, and a camera finds itself in it.
TEST_F(MapLife, OtherProgramsMaps) {
  ASSERT_EQ(run("left", "a").exit_code, 0);
  const slam::Map map = readMap("a/map.json").map;
  for (const std::string format : {"aruco", "tagslam", "wpilib"}) {
    ASSERT_EQ(
        waymark({"map", "export", path("a/map.json"), "--format", format, path(format)}).exit_code,
        0);
    const ProgramResult import =
        waymark({"map", "import", path(format), "--format", format, "--dictionary", "4X4_50",
                 "--size", "0.2", path(format + ".json")});
    ASSERT_EQ(import.exit_code, 0) << import.err;
    const slam::Map back = readMap(format + ".json").map;
    ASSERT_EQ(back.markers().size(), io::posedMarkerCorners(map).size());
    for (const auto& [id, marker] : back.markers()) {
      EXPECT_NEAR(marker.size_m, 0.2, 1e-9);
      EXPECT_LT((marker.T_w_m->p - map.find(id)->T_w_m->p).norm(), 1e-9);
      EXPECT_LT((marker.T_w_m->R - map.find(id)->T_w_m->R).norm(), 1e-9);
    }
    const ProgramResult in_left =
        run("left", "in_" + format, {"--map-in", path(format + ".json"), "--localize-only"});
    EXPECT_EQ(in_left.exit_code, 0) << in_left.err;
    EXPECT_EQ(localized(path("in_" + format)), 60);
    const ProgramResult grown = run("right", "on_" + format, {"--map-in", path(format + ".json")});
    EXPECT_EQ(grown.exit_code, 0) << grown.err;
    EXPECT_LT(worstDistance(readMap("on_" + format + "/map.json").map), 0.05);
    EXPECT_EQ(readMap("on_" + format + "/map.json").field, readMap(format + ".json").field);
  }
  for (const std::string format : {"ply", "tum"}) {
    EXPECT_EQ(
        waymark({"map", "export", path("a/map.json"), "--format", format, path(format)}).exit_code,
        0);
  }
  EXPECT_EQ(readFile(path("ply")).rfind("ply\n", 0), 0U);
  const std::string poses = readFile(path("tum"));
  EXPECT_EQ(static_cast<std::size_t>(std::count(poses.begin(), poses.end(), '\n')),
            map.keyframes().size() + 1);  // and a comment
  expectBadInput(waymark({"map", "export", path("aruco.json"), "--format", "tum", path("none")}),
                 "aruco.json: has no keyframes");
  expectBadInput(waymark({"map", "export", path("a/map.json"), "--format", "obj", path("none")}),
                 "--format");
  expectBadInput(
      waymark({"map", "import", path("wpilib"), "--format", "wpilib", "--size", "1", path("none")}),
      "wpilib: does not say which dictionary; give --dictionary");
  expectBadInput(waymark({"map", "import", path("wpilib"), "--format", "wpilib", "--dictionary",
                          "4X4_50", path("none")}),
                 "has no size; give one with --size");
  EXPECT_FALSE(fs::exists(path("none")));
}

TEST_F(MapLife, Merge) {
  ASSERT_EQ(run("left", "a").exit_code, 0);
  ASSERT_EQ(run("right", "b").exit_code, 0);
  const ProgramResult result =
      waymark({"map", "merge", path("a/map.json"), path("b/map.json"), path("both.json")});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("shared markers agree"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("optimized: "), std::string::npos);
  const slam::Map both = readMap("both.json").map;
  EXPECT_EQ(io::posedMarkerCorners(both).size(), 48U);
  EXPECT_EQ(both.keyframes().size(), readMap("a/map.json").map.keyframes().size() +
                                         readMap("b/map.json").map.keyframes().size());
  EXPECT_LT(worstDistance(both), 0.02);
  // And it is a map to go on with.
  const ProgramResult on = run("right", "c", {"--map-in", path("both.json"), "--localize-only"});
  EXPECT_EQ(on.exit_code, 0) << on.err;
  EXPECT_EQ(localized(path("c")), 60);

  expectBadInput(waymark({"map", "merge", path("a/map.json"), path("none.json")}),
                 "map merge needs two maps and a file to write");
  expectBadInput(waymark({"map", "merge", path("a/map.json"), path("b/map.json"), "--tolerance",
                          "0.000001", path("none.json")}),
                 "b/map.json: too few shared markers agree within 1e-06 m: of ");
  EXPECT_FALSE(fs::exists(path("none.json")));
}

}  // namespace
// The first marker of a map is its origin, the x axis points to the second.
TEST_F(MapLife, IsAlignedByItsMarkers) {
  ASSERT_EQ(run("left", "a").exit_code, 0);
  const std::vector<int> ids = posedIds("a/map.json");
  ASSERT_GE(ids.size(), 2U);
  const std::string first = std::to_string(ids[0]);
  const std::string second = std::to_string(ids[1]);
  const auto align = [&](std::vector<std::string> more) {
    std::vector<std::string> arguments = {"map", "align", path("a/map.json"), "--out",
                                          path("aligned.json")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return waymark(arguments);
  };
  expectBadInput(align({"--xy", second}), "nothing to align by: give --floor, --up or --origin");
  expectBadInput(align({"--floor", "1-x"}), "--floor: '1-x' must be an id or a range of ids");
  expectBadInput(align({"--origin", "49"}), "a/map.json: marker 49 has no place in the map");
  EXPECT_FALSE(fs::exists(path("aligned.json")));

  const ProgramResult result = align({"--origin", first, "--xy", second});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_TRUE(result.out.starts_with("moved by ")) << result.out;
  const slam::Map map = readMap("aligned.json").map;
  EXPECT_LT(map.findPosed(ids[0])->T_w_m->p.norm(), 1e-9);
  EXPECT_LT(map.findPosed(ids[1])->T_w_m->p.tail<2>().norm(), 1e-9);
  EXPECT_GT(map.findPosed(ids[1])->T_w_m->p.x(), 0.1);
  // And it is a map to go on with.
  const ProgramResult on = run("left", "b", {"--map-in", path("aligned.json"), "--localize-only"});
  EXPECT_EQ(on.exit_code, 0) << on.err;
  EXPECT_EQ(localized(path("b")), 60);
}

// A tape that was misread by 30 cm is told, and bends nothing.
TEST_F(MapLife, WhatTheMapContradictsIsALine) {
  ASSERT_EQ(run("left", "a").exit_code, 0);
  const std::vector<int> ids = posedIds("a/map.json");
  ASSERT_GE(ids.size(), 4U);
  const auto distance = [&](int a, int b, double off_m) {
    const Eigen::Vector3d corner = slam::markerCorners(MarkerWall::kSize_m)[0];
    const double truth_m = (wall_.markers[static_cast<std::size_t>(a)].T_w_m * corner -
                            wall_.markers[static_cast<std::size_t>(b)].T_w_m * corner)
                               .norm();
    return "[[slam.markers.distances]]\nid_a = " + std::to_string(a) +
           "\ncorner_a = 0\nid_b = " + std::to_string(b) +
           "\ncorner_b = 0\ndistance_m = " + std::to_string(truth_m + off_m) + "\n";
  };
  std::ofstream(path("tape.toml"))
      << distance(ids[0], ids[1], 0.0) << distance(ids[2], ids[3], 0.3);
  const ProgramResult result = run("left", "b", {"--config", path("tape.toml")});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::string marker = "waymark: warning: marker " + std::to_string(ids[2]) + ": ";
  const auto line = result.err.find(marker);
  ASSERT_NE(line, std::string::npos) << result.err;
  EXPECT_NE(result.err.find(" sigmas from distance " + std::to_string(ids[2]) + "/0 to ", line),
            std::string::npos);
  EXPECT_EQ(result.err.find(" sigmas ", result.err.find('\n', line)), std::string::npos) << "once";
  EXPECT_LT(worstDistance(readMap("b/map.json").map), 0.02);
}

}  // namespace waymark
