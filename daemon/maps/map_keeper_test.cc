#include "daemon/maps/map_keeper.h"

#include <algorithm>
#include <filesystem>
#include <functional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <sys/mount.h>

#include "io/maps/map_file.h"
#include "io/text/text_file.h"
#include "slam/testing/synthetic.h"
#include "tests/small_disk.h"
#include "tests/temporary_directory.h"

namespace waymark::daemon {
namespace {

using slam::testing::SyntheticMarker;

constexpr double kSize_m = 0.2;

// A camera before a wall of markers, as far as the SLAM sees it.
class MapKeeper : public ::testing::Test {
 protected:
  MapKeeper() : wall_(slam::testing::markerWall(2, 4, 0.5, &rng_)) {
    settings_.dictionary = "4X4_50";
    settings_.options.markers.size_m = kSize_m;
  }

  // Runs the SLAM over some frames, from `map` on.
  void run(slam::Map map, const std::function<void(slam::Slam&)>& use) {
    const slam::CameraModel camera(camera_);
    slam::Slam slam(camera, *slam::Dictionary::byName("4X4_50"), settings_.options, std::move(map));
    for (int i = 0; i < 20; ++i) {
      const auto T_w_c = slam::testing::lookAt({0.05 * i, 0.0, 0.02 * i}, {0.0, 3.0, 0.0});
      const auto seen = slam::testing::observeAll(camera, T_w_c, wall_, kSize_m, 0.05, &rng_);
      slam.process({.time = {static_cast<std::uint64_t>(i), i * 33'000'000LL}, .detections = seen});
    }
    use(slam);
  }

  std::string saved(slam::Slam& slam) {
    const Result<std::string> result = saveMap(settings_, slam);
    return result ? *result : "error: " + result.error().message;
  }

  const testing::TemporaryDirectory directory_;
  const std::filesystem::path file_ = directory_ / "map.json";
  std::mt19937 rng_{7};
  std::vector<SyntheticMarker> wall_;
  slam::Calibration camera_ = slam::testing::testCalibration();
  io::SlamSettings settings_;
};

TEST_F(MapKeeper, LearnsFromStartToStart) {
  settings_.map.in = settings_.map.out = file_;
  Result<StartMap> first = readStartMap(settings_, camera_);
  ASSERT_TRUE(first) << first.error().message;
  EXPECT_TRUE(first->map.empty());
  ASSERT_EQ(first->notes.size(), 1U);
  EXPECT_TRUE(first->notes[0].ends_with("map.json: not there yet; beginning a new map"));
  run(std::move(first->map), [&](slam::Slam& slam) {
    EXPECT_TRUE(saved(slam).starts_with(file_.string() + ": saved 8 markers, ")) << saved(slam);
  });
  Result<StartMap> second = readStartMap(settings_, camera_);
  ASSERT_TRUE(second) << second.error().message;
  EXPECT_EQ(second->map.markers().size(), 8U);
  EXPECT_TRUE(second->notes.back().starts_with(file_.string() + ": going on with 8 markers, "));
  run(std::move(second->map), [&](slam::Slam& slam) {
    EXPECT_EQ(slam.counters().localized, 20U);
    EXPECT_TRUE(saved(slam).starts_with(file_.string() + ": saved 8 markers, "));
  });
}

// The second start of a daemon that has no calibration.
TEST_F(MapKeeper, GoesOnWithTheLensItHasLearned) {
  settings_.map.in = settings_.map.out = file_;
  slam::Calibration learned = camera_;
  learned.covariance = 1e-2 * slam::IntrinsicMatrix::Identity();
  camera_ = learned;
  run({}, [&](slam::Slam& slam) { (void)saved(slam); });
  slam::Calibration guess = slam::testing::testCalibration();
  guess.fx = guess.fy = 0.6 * guess.fx;
  settings_.options.lens.takeForGuess(/*fov_said=*/false);
  const Result<StartMap> start = readStartMap(settings_, guess);
  ASSERT_TRUE(start) << start.error().message;
  ASSERT_TRUE(start->lens);
  EXPECT_EQ(start->lens->fx, learned.fx);
  EXPECT_TRUE(start->lens->covariance);
  EXPECT_TRUE(start->options.lens.given);
}

TEST_F(MapKeeper, LocalizesAndChangesNothing) {
  settings_.map.out = file_;
  run({}, [&](slam::Slam& slam) { (void)saved(slam); });
  const std::string before = *io::readTextFile(file_);
  settings_.map = {.in = file_, .out = {}, .localize_only = true};
  settings_.options.mapping = false;
  Result<StartMap> start = readStartMap(settings_, camera_);
  ASSERT_TRUE(start) << start.error().message;
  run(std::move(start->map), [&](slam::Slam& slam) {
    EXPECT_EQ(slam.counters().localized, 20U);
    EXPECT_EQ(saved(slam), "");
    // In memory too, bit for bit.
    EXPECT_TRUE(io::formatMap(slam.map(), camera_) == before);
  });
  EXPECT_TRUE(*io::readTextFile(file_) == before);
}

TEST_F(MapKeeper, KeepsAMapInPieces) {
  settings_.map.in = settings_.map.out = file_;
  settings_.options.pieces.begin = true;
  const std::vector<SyntheticMarker> here = wall_;
  std::vector<SyntheticMarker> there = wall_;
  for (SyntheticMarker& marker : there) marker.id += 20;
  const slam::CameraModel camera(camera_);
  const auto walk = [&](slam::Slam& slam, const std::vector<SyntheticMarker>& room, int from) {
    int piece = -1;
    for (int i = from; i < from + 10; ++i) {
      const auto T_w_c = slam::testing::lookAt({0.05 * i, 0.0, 0.02 * i}, {0.0, 3.0, 0.0});
      const auto seen = slam::testing::observeAll(camera, T_w_c, room, kSize_m, 0.05, &rng_);
      const auto result = slam.process(
          {.time = {static_cast<std::uint64_t>(i), i * 33'000'000LL}, .detections = seen});
      if (result.pose) piece = result.pose->piece;
    }
    return piece;
  };
  const auto first = makeSlam(settings_, camera_, settings_.options, {});
  EXPECT_EQ(walk(*first, here, 0), 0);
  EXPECT_EQ(walk(*first, there, 10), 1);
  EXPECT_TRUE(saved(*first).ends_with(" keyframes in 2 pieces")) << saved(*first);

  Result<StartMap> start = readStartMap(settings_, camera_);
  ASSERT_TRUE(start) << start.error().message;
  EXPECT_TRUE(start->warnings.empty());
  EXPECT_TRUE(start->notes.back().ends_with(" in 2 pieces")) << start->notes.back();
  settings_.options.mapping = false;
  const auto second =
      makeSlam(settings_, camera_, settings_.options, start->map, std::move(start->others));
  EXPECT_EQ(walk(*second, there, 0), 1);
  EXPECT_EQ(walk(*second, here, 10), 0);
  EXPECT_TRUE(mapText(*second) == start->text) << "bit for bit";
}

TEST_F(MapKeeper, WithoutAMapTheOldFileStays) {
  settings_.map.out = file_;
  ASSERT_TRUE(io::writeTextFile(file_, "old"));
  wall_.clear();
  run({}, [&](slam::Slam& slam) {
    EXPECT_EQ(saved(slam), file_.string() + ": there is no map to save");
  });
  EXPECT_EQ(*io::readTextFile(file_), "old");
}

// After a power cut, wherever it cut the file off: the map before is used, and said so.
TEST_F(MapKeeper, ADamagedFileGivesWayToTheOneBefore) {
  settings_.map.in = settings_.map.out = file_;
  run({}, [&](slam::Slam& slam) { (void)saved(slam); });
  const std::string before = *io::readTextFile(file_);
  run(readStartMap(settings_, camera_)->map, [&](slam::Slam& slam) { (void)saved(slam); });
  const std::string text = *io::readTextFile(file_);
  ASSERT_NE(text, before);
  ASSERT_EQ(*io::readTextFile(previousOf(file_)), before);
  EXPECT_TRUE(readStartMap(settings_, camera_)->warnings.empty());

  const auto startsWithPrevious = [&](const std::string& what) {
    const Result<StartMap> start = readStartMap(settings_, camera_);
    ASSERT_TRUE(start) << what << ": " << start.error().message;
    ASSERT_EQ(start->warnings.size(), 1U) << what;
    EXPECT_TRUE(start->warnings[0].starts_with(file_.string() + ":")) << start->warnings[0];
    EXPECT_TRUE(start->warnings[0].ends_with("; using the map before it")) << start->warnings[0];
    EXPECT_EQ(start->warnings[0].find('\n'), std::string::npos);
    EXPECT_EQ(io::formatMap(start->map, camera_), before) << what;
  };
  for (std::size_t size = 0; size + 2 < text.size(); size += 1 + text.size() / 100) {
    ASSERT_TRUE(io::writeTextFile(file_, text.substr(0, size)));
    startsWithPrevious("cut off after " + std::to_string(size) + " bytes");
  }
  std::string zeroed = text;
  std::fill(zeroed.begin() + static_cast<std::ptrdiff_t>(zeroed.size() / 2), zeroed.end(), '\0');
  ASSERT_TRUE(io::writeTextFile(file_, zeroed));
  startsWithPrevious("zeros");
  std::string changed = text;
  changed[changed.find("0.") + 2] ^= 1;
  ASSERT_TRUE(io::writeTextFile(file_, changed));
  startsWithPrevious("one bit");
  std::filesystem::remove(file_);
  startsWithPrevious("missing");

  // Saving on from there leaves the good one in its place, whatever stands before it.
  ASSERT_TRUE(io::writeTextFile(file_, text.substr(0, 1000)));
  run(readStartMap(settings_, camera_)->map, [&](slam::Slam& slam) {
    EXPECT_TRUE(saved(slam).starts_with(file_.string() + ": saved 8 markers"));
  });
  EXPECT_EQ(*io::readTextFile(previousOf(file_)), before);
  EXPECT_TRUE(io::readMap(file_));
}

TEST_F(MapKeeper, WithBothDamagedTheErrorIsThatOfTheFile) {
  settings_.map.in = settings_.map.out = file_;
  ASSERT_TRUE(io::writeTextFile(file_, "{"));
  ASSERT_TRUE(io::writeTextFile(previousOf(file_), "["));
  const Result<StartMap> start = readStartMap(settings_, camera_);
  ASSERT_FALSE(start);
  EXPECT_TRUE(start.error().message.starts_with(file_.string() + ":")) << start.error().message;
}

// A map that is whole but does not fit says that something else is wrong.
TEST_F(MapKeeper, AWholeMapThatDoesNotFitIsNoDamage) {
  settings_.map.in = settings_.map.out = file_;
  run({}, [&](slam::Slam& slam) { (void)saved(slam); });
  std::filesystem::copy(file_, previousOf(file_));
  settings_.options.markers.size_m = 2 * kSize_m;
  const Result<StartMap> start = readStartMap(settings_, camera_);
  ASSERT_FALSE(start);
  EXPECT_NE(start.error().message.find("has a side of"), std::string::npos);
}

TEST_F(MapKeeper, AMapThatIsAsItWasIsNotWrittenAgain) {
  settings_.map.out = file_;
  run({}, [&](slam::Slam& slam) {
    (void)saved(slam);
    EXPECT_TRUE(writeMap(settings_, slam)->find("is as it was") != std::string::npos);
  });
  EXPECT_FALSE(std::filesystem::exists(previousOf(file_)));
}

// A disk that was not unmounted comes up read-only; the robot is to find its way all the same.
TEST_F(MapKeeper, AReadOnlyDiskIsNoReasonNotToStart) {
  const std::filesystem::path place = directory_ / "disk";
  const waymark::testing::SmallDisk disk(place, "1m");
  if (!disk) GTEST_SKIP() << "only root can mount a small file system";
  settings_.map.in = settings_.map.out = place / "map.json";
  run({}, [&](slam::Slam& slam) { (void)saved(slam); });
  ASSERT_EQ(::mount("", place.c_str(), nullptr, MS_REMOUNT | MS_RDONLY, nullptr), 0);
  const Result<StartMap> start = readStartMap(settings_, camera_);
  ASSERT_TRUE(start) << start.error().message;
  EXPECT_EQ(start->map.markers().size(), 8U);
  EXPECT_NE(start->not_writable.find("Read-only file system"), std::string::npos)
      << start->not_writable;
  ASSERT_EQ(start->warnings.size(), 1U);
  EXPECT_TRUE(start->warnings[0].starts_with(start->not_writable));
  settings_.map.in = settings_.map.out = place / "new" / "map.json";
  EXPECT_TRUE(readStartMap(settings_, camera_)) << "without a map, too";
  ASSERT_EQ(::mount("", place.c_str(), nullptr, MS_REMOUNT, nullptr), 0);
  EXPECT_EQ(readStartMap(settings_, camera_)->not_writable, "");
}

TEST_F(MapKeeper, WhatCannotBeReadOrWritten) {
  const auto errorOf = [&](const io::MapSettings& map) {
    settings_.map = map;
    const Result<StartMap> start = readStartMap(settings_, camera_);
    return start ? "no error" : start.error().message;
  };
  EXPECT_EQ(errorOf({}), "no error");
  EXPECT_NE(errorOf({.in = file_, .out = {}}).find("map.json: cannot be read"), std::string::npos);
  EXPECT_NE(errorOf({.in = {}, .out = "/proc/none/map.json"}).find("/proc/none: "),
            std::string::npos);
  EXPECT_NE(errorOf({.in = {}, .out = directory_.path()}).find(": is a directory"),
            std::string::npos);
  slam::Map nothing;
  nothing.dictionary = "4X4_50";
  ASSERT_TRUE(io::writeTextFile(file_, io::formatMap(nothing, std::nullopt)));
  EXPECT_NE(errorOf({.in = file_, .out = {}, .localize_only = true}).find("none has a pose"),
            std::string::npos);
  ASSERT_TRUE(io::writeTextFile(file_, "{}"));
  EXPECT_NE(errorOf({.in = file_, .out = file_}).find("map.json: format: is missing"),
            std::string::npos);
}

}  // namespace
}  // namespace waymark::daemon
