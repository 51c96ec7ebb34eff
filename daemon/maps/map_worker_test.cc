#include "daemon/maps/map_worker.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <map>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include <gtest/gtest.h>

#include "capture/frame.h"
#include "daemon/maps/testing_map_worker.h"
#include "io/calibrations/calibration_file.h"
#include "io/maps/map_file.h"
#include "io/text/text_file.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

class MapWorkerTest : public testing::MapWorkerFixture {
 protected:
  // One job, and what came of it.
  std::string outcomeOf(const std::function<void(MapWorker::Done)>& ask) {
    std::promise<std::string> told;
    ask([&](const Result<std::string>& result) {
      told.set_value(result ? *result : "error: " + result.error().message);
    });
    return told.get_future().get();
  }
  std::string save() {
    return outcomeOf([&](auto done) { worker_->save(std::move(done)); });
  }
  std::string load(const fs::path& file) {
    return outcomeOf([&](auto done) { worker_->load(file, std::move(done)); });
  }
  std::string reset() {
    return outcomeOf([&](auto done) { worker_->reset(std::move(done)); });
  }
  std::map<std::string, std::uint64_t> counters() const {
    std::map<std::string, std::uint64_t> all;
    worker_->reportCounters([&](const char* name, std::uint64_t value) { all[name] = value; });
    return all;
  }
  // What the SLAM loop says of the next frame.
  slam::Counters countersAfterAFrame() {
    capture::FramePtr frame = pool_.acquire();
    std::fill_n(frame->pixels(), camera_.width * camera_.height, std::uint8_t{90});
    frame->setStamp({.sequence = static_cast<std::uint64_t>(sequence_),
                     .monotonic_ns = 10'000'000'000 + 1000 * sequence_});
    ++sequence_;
    frames_.push(std::move(frame));
    FrameRecord record;
    EXPECT_TRUE(output_.records.wait_dequeue_timed(record, 10'000'000));
    return record.counters;
  }
  [[nodiscard]] static bool eventually(const std::function<bool()>& holds) {
    const auto until = std::chrono::steady_clock::now() + milliseconds(10'000);
    while (!holds()) {
      if (std::chrono::steady_clock::now() > until) return false;
      std::this_thread::sleep_for(milliseconds(10));
    }
    return true;
  }
};

TEST_F(MapWorkerTest, SavesWhileTheLoopWaitsForFrames) {
  start(wallMap());
  EXPECT_TRUE(save().starts_with(file_.string() + ": saved 8 markers, "));
  const auto map = io::readMap(file_);
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_EQ(map->map.markers().size(), 8U);
  EXPECT_EQ(counters()["map.saves"], 1U);
  EXPECT_FALSE(worker_->report().changed);
  EXPECT_GT(worker_->report().saved_ns, 0);
}

TEST_F(MapWorkerTest, AResetBeginsANewMapAndNoCounterGoesBack) {
  start(wallMap());
  const slam::Counters before = countersAfterAFrame();
  EXPECT_EQ(reset(), "beginning a new map; the one before is in " + file_.string() + ".replaced");
  EXPECT_TRUE(worker_->report().changed);
  const slam::Counters after = countersAfterAFrame();
  EXPECT_EQ(after.frames, before.frames + 1);
  EXPECT_EQ(after.full_scans, before.full_scans + 1);
  EXPECT_EQ(save(), "error: there is no map to save");
  EXPECT_FALSE(fs::exists(file_));
  EXPECT_EQ(counters()["map.resets"], 1U);
  const MapSnapshot* told = output_.map.take();
  ASSERT_NE(told, nullptr) << "subscribers learn of it";
  EXPECT_TRUE(told->markers.empty());
}

// What is known of the lens is known in another map, too.
TEST_F(MapWorkerTest, TheLensInUseIsToldAndKept) {
  camera_.covariance = 1e-4 * slam::IntrinsicMatrix::Identity();
  const std::string known = io::formatCalibration(camera_);
  start(wallMap());
  const auto calibration = [&] {
    return outcomeOf([&](auto done) { worker_->calibration(std::move(done)); });
  };
  EXPECT_EQ(calibration(), known);
  (void)reset();
  EXPECT_EQ(calibration(), known);
}

// Two saves take away what was saved before; what was replaced is still there.
TEST_F(MapWorkerTest, TheMapThatWasReplacedIsKept) {
  const fs::path replaced = replacedOf(file_);
  const fs::path other = directory_ / "other.json";
  ASSERT_TRUE(io::writeTextFile(other, io::formatMap(wallMap(), camera_)));
  start(wallMap());
  (void)save();
  (void)reset();
  auto map = io::readMap(replaced);
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_EQ(map->map.markers().size(), 8U);
  const std::string first = *io::readTextFile(replaced);
  EXPECT_EQ(reset(), "beginning a new map") << "there was none to keep";
  EXPECT_EQ(load(other).find("the one before"), std::string::npos);
  EXPECT_EQ(*io::readTextFile(replaced), first);
  EXPECT_TRUE(load(other).ends_with("; the one before is in " + replaced.string()));
  EXPECT_NE(*io::readTextFile(replaced), first);

  fs::remove(replaced);
  fs::create_directory(replaced);
  EXPECT_NE(reset().find("beginning a new map; the one before is not kept: "), std::string::npos);
  EXPECT_EQ(counters()["map.save_failures"], 1U);
}

TEST_F(MapWorkerTest, WhatIsTooLargeForAMapIsNotRead) {
  start(wallMap());
  const fs::path large = directory_ / "large.json";
  ASSERT_TRUE(io::writeTextFile(large, "{"));
  fs::resize_file(large, std::uintmax_t{3} << 30U);
  EXPECT_EQ(load(large), "error: " + large.string() + ": is larger than 256 MiB");
}

// A tape measure misread by 2 m, in the log once; the other one, which fits, is not.
TEST_F(MapWorkerTest, WhatSurveyorsSayAndTheMapDoesNotIsInTheLog) {
  settings_.options.markers.constraints.distances = {{.id_a = 0, .id_b = 1, .distance_m = 2.5},
                                                     {.id_a = 2, .id_b = 3, .distance_m = 0.5}};
  start(wallMap());
  log_.setLevel(LogLevel::kWarning);
  ::testing::internal::CaptureStderr();
  EXPECT_TRUE(save().starts_with(file_.string() + ": saved 8 markers, "));
  const std::string told = ::testing::internal::GetCapturedStderr();
  EXPECT_NE(told.find("waymarkd: warning: marker 0: "), std::string::npos) << told;
  EXPECT_NE(told.find(" sigmas from distance 0/0 to 1/0"), std::string::npos) << told;
  EXPECT_EQ(std::ranges::count(told, '\n'), 1) << told;
  ::testing::internal::CaptureStderr();
  (void)save();
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
}

// While one is done, so many wait, and whoever has gone leaves his place.
TEST_F(MapWorkerTest, JobsThatWaitAreLimitedAndThoseOfOthersForgotten) {
  start(wallMap());
  std::promise<void> begun;
  std::promise<void> go_on;
  worker_->save([&](const auto&) {
    begun.set_value();
    go_on.get_future().wait();
  });
  begun.get_future().wait();
  constexpr std::uint64_t kGone = 0;
  constexpr std::uint64_t kStays = 1;
  std::atomic<int> done{0};
  std::atomic<int> refused{0};
  const auto count = [&](const Result<std::string>& result) {
    ++(result ? done : refused);
    if (!result) {
      EXPECT_EQ(result.error().message, "16 others wait already; try again later");
    }
  };
  for (int i = 0; i < 1000; ++i) worker_->save(count, kGone);
  EXPECT_EQ(refused, 984);
  EXPECT_EQ(counters()["map.jobs_refused"], 984U);
  worker_->forget(kGone);
  for (int i = 0; i < 3; ++i) worker_->save(count, kStays);
  go_on.set_value();
  EXPECT_TRUE(eventually([&] { return done == 3; }));
  stop();
  EXPECT_EQ(done, 3);
  EXPECT_EQ(refused, 984);
}

TEST_F(MapWorkerTest, LoadsAnotherMap) {
  const fs::path other = directory_ / "other.json";
  ASSERT_TRUE(io::writeTextFile(other, io::formatMap(wallMap(), camera_)));
  settings_.map.in = other;
  start({});
  EXPECT_TRUE(load(other).starts_with(other.string() + ": going on with 8 markers, "));
  // The SLAM loop says so right after it has answered.
  for (int i = 0; i < 500 && output_.map_markers != 8; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_EQ(output_.map_markers, 8);
  (void)reset();
  EXPECT_TRUE(load("").starts_with(other.string() + ": going on with")) << "that of the start";
  EXPECT_EQ(counters()["map.loads"], 2U);
}

TEST_F(MapWorkerTest, WhatCannotBeLoadedLeavesEverythingAsItWas) {
  start(wallMap());
  (void)save();
  const std::string good = *io::readTextFile(file_);
  const fs::path bad = directory_ / "bad.json";
  const auto errorOf = [&](const std::string& text) {
    EXPECT_TRUE(io::writeTextFile(bad, text));
    return load(bad);
  };
  EXPECT_NE(errorOf("").find("error: " + bad.string()), std::string::npos);
  EXPECT_NE(errorOf(good.substr(0, good.size() / 2)).find("bad.json"), std::string::npos);
  slam::Map foreign;
  foreign.dictionary = "5X5_50";
  EXPECT_NE(errorOf(io::formatMap(foreign, std::nullopt)).find("but 4X4_50 is looked for"),
            std::string::npos);
  slam::Calibration wider = camera_;
  wider.width += 2;
  EXPECT_NE(errorOf(io::formatMap(wallMap(), wider)).find("camera: has another image size"),
            std::string::npos);
  EXPECT_NE(load("/nowhere.json").find("/nowhere.json: cannot be read"), std::string::npos);
  EXPECT_EQ(load("/dev/zero"), "error: /dev/zero: is not a file");
  EXPECT_EQ(counters()["map.load_failures"], 6U);
  EXPECT_EQ(counters()["map.loads"], 0U);
  EXPECT_EQ(output_.map_revision, 0U) << "nothing was swapped";
  stopLoop();
  EXPECT_EQ(loop_->slam().map().markers().size(), 8U);
}

TEST_F(MapWorkerTest, SavesByItselfWhenTheMapHasChangedAndTriesAgain) {
  settings_.map.out = directory_ / "later" / "map.json";
  settings_.map.save_interval_s = 1;
  ASSERT_TRUE(io::writeTextFile(file_, io::formatMap(wallMap(), camera_)));
  start({});
  (void)load(file_);  // a change
  ASSERT_TRUE(eventually([&] { return counters()["map.save_failures"] >= 2; }));
  EXPECT_NE(worker_->report().last_save.find("cannot be written"), std::string::npos);
  fs::create_directory(directory_ / "later");
  ASSERT_TRUE(eventually([&] { return counters()["map.saves"] == 1; }));
  EXPECT_TRUE(io::readMap(settings_.map.out));
  std::this_thread::sleep_for(milliseconds(1200));
  EXPECT_EQ(counters()["map.saves"], 1U) << "nothing has changed since";
  worker_->setSaveInterval(0);
  (void)load(file_);
  std::this_thread::sleep_for(milliseconds(1200));
  EXPECT_EQ(counters()["map.saves"], 1U);
}

TEST_F(MapWorkerTest, AtTheEndWhatHasChangedIsSaved) {
  start(wallMap());
  (void)save();
  stop();
  const auto nothing = worker_->saveAtEnd(loop_->slam());
  ASSERT_TRUE(nothing);
  EXPECT_EQ(*nothing, "") << "it is saved already";
  output_.map_revision.fetch_add(1);
  const auto saved = worker_->saveAtEnd(loop_->slam());
  ASSERT_TRUE(saved) << saved.error().message;
  EXPECT_TRUE(saved->starts_with(file_.string() + ": "));
}

TEST_F(MapWorkerTest, LocalizeOnlyNeitherWritesNorResets) {
  settings_.map.localize_only = true;
  settings_.map.out.clear();
  settings_.options.mapping = false;
  start(wallMap());
  EXPECT_EQ(save(), "error: with slam.localize_only no map is written");
  EXPECT_EQ(reset(), "error: with slam.localize_only the map stays as it is");
}

TEST_F(MapWorkerTest, AfterTheLoopThereIsNothingToDo) {
  start(wallMap());
  stopLoop();
  EXPECT_EQ(save(), "error: the daemon is stopping");
  EXPECT_EQ(reset(), "error: the daemon is stopping");
  stop();
  EXPECT_EQ(save(), "error: the daemon is stopping");
  EXPECT_EQ(counters()["map.save_failures"], 0U);
}

}  // namespace
}  // namespace waymark::daemon
