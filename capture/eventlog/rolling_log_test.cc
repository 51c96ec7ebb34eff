#include "capture/eventlog/rolling_log.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "capture/eventlog/testing_log.h"
#include "tests/small_disk.h"
#include "tests/temporary_directory.h"

namespace waymark::eventlog {
namespace {

namespace fs = std::filesystem;
using testing::Bytes;
using waymark::testing::SmallDisk;

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kSecond_us = 1'000'000;
constexpr std::uint64_t kMiB = std::uint64_t{1} << 20U;

class RollingLogTest : public ::testing::Test {
 protected:
  RollingLogTest() {
    options_.directory = directory_ / "logs";
    options_.keep_free_bytes = 0;
  }

  RollingLog open() {
    Result<RollingLog> log = RollingLog::open(options_);
    EXPECT_TRUE(log.ok()) << log.error().message;
    return std::move(log).value();
  }
  // `mib` events of a MiB each, `pause_s` apart.
  void record(RollingLog* log, int mib, std::int64_t pause_s = 0) {
    const Bytes data(kMiB - 100, 7);
    for (int i = 0; i < mib; ++i) {
      now_s_ += pause_s;
      log->append(kEpoch_s * kSecond_us + now_s_ * kSecond_us, "IMAGE", data, now_s_ * kSecond_ns);
      log->maintain(now_s_ * kSecond_ns);
    }
  }
  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> all;
    for (const fs::directory_entry& entry : fs::directory_iterator(options_.directory)) {
      all.push_back(entry.path().filename());
    }
    std::ranges::sort(all);
    return all;
  }

  static constexpr std::int64_t kEpoch_s = 1'700'000'000;  // 2023-11-14 22:13:20
  waymark::testing::TemporaryDirectory directory_;
  RollingOptions options_;
  std::int64_t now_s_ = 0;
};

TEST_F(RollingLogTest, BeginsANewFileWhenOneIsFull) {
  options_.file_bytes = 3 * kMiB;
  RollingLog log = open();
  record(&log, 7);
  log.finish();
  EXPECT_EQ(names(), (std::vector<std::string>{"waymark-20231114T221320.000Z-0000.lcmlog",
                                               "waymark-20231114T221320.000Z-0001.lcmlog",
                                               "waymark-20231114T221320.000Z-0002.lcmlog"}));
  EXPECT_EQ(log.counters().events, 7u);
  EXPECT_EQ(log.counters().files, 3u);
}

TEST_F(RollingLogTest, BeginsANewFileAfterItsTime) {
  options_.file_s = 10;
  RollingLog log = open();
  record(&log, 4, 6);
  EXPECT_EQ(names().size(), 2u);
}

TEST_F(RollingLogTest, TheOldestGiveWayAndStrangersStay) {
  options_.file_bytes = 2 * kMiB;
  options_.quota_bytes = 6 * kMiB;
  fs::create_directories(options_.directory);
  testing::writeAll(options_.directory / "holiday.lcmlog", Bytes(9 * kMiB, 1));
  RollingLog log = open();
  record(&log, 20, 2);
  log.finish();
  std::uint64_t total = 0;
  for (const std::string& name : names()) {
    if (name != "holiday.lcmlog") total += fs::file_size(options_.directory / name);
  }
  EXPECT_LE(total, options_.quota_bytes);
  EXPECT_GE(total, options_.quota_bytes - options_.file_bytes);
  EXPECT_GT(log.counters().deleted, 5u);
  EXPECT_EQ(log.counters().lost, 0u);
  EXPECT_TRUE(fs::exists(options_.directory / "holiday.lcmlog"));
}

TEST_F(RollingLogTest, ATornLogIsCutWhenTheNextRunBegins) {
  {
    RollingLog log = open();
    record(&log, 3);
    log.finish();
  }
  const fs::path torn = options_.directory / names().front();
  const std::uint64_t whole = fs::file_size(torn);
  Bytes bytes = testing::readAll(torn);
  bytes.resize(bytes.size() + 5000, 0xED);
  testing::writeAll(torn, bytes);
  RollingLog log = open();
  EXPECT_EQ(fs::file_size(torn), whole);
  EXPECT_EQ(log.repaired(),
            torn.string() + ": cut off the last 5000 bytes, which were no whole event");
  record(&log, 1);
  log.finish();
  EXPECT_EQ(names().size(), 2u) << "a run of its own, though in the same second";
}

TEST_F(RollingLogTest, PausesBeforeTheDiskIsFull) {
  options_.keep_free_bytes = ~std::uint64_t{0} / 4;
  RollingLog log = open();
  record(&log, 2);
  EXPECT_EQ(log.state(), RollingLog::State::kPaused);
  EXPECT_NE(log.reason().find("the disk is full"), std::string::npos) << log.reason();
  EXPECT_EQ(log.counters().lost, 2u);
  EXPECT_EQ(log.counters().pauses, 1u);
  EXPECT_TRUE(names().empty());
}

// Somebody else fills the disk meanwhile.
TEST_F(RollingLogTest, GoesOnWhenThereIsRoomAgain) {
  const SmallDisk disk(options_.directory, "64m");
  if (!disk) GTEST_SKIP() << "only root can mount a small file system";
  options_.keep_free_bytes = 10 * kMiB;
  RollingLog log = open();
  record(&log, 5, 1);
  const fs::path stranger = options_.directory / "stranger";
  testing::writeAll(stranger, Bytes(52 * kMiB, 1));
  record(&log, 5, 1);
  EXPECT_EQ(log.state(), RollingLog::State::kPaused) << "stopped in time";
  const std::uint64_t events = log.counters().events;
  EXPECT_LE(events, 6u);
  fs::remove(stranger);
  record(&log, 5, 1);
  EXPECT_EQ(log.state(), RollingLog::State::kRecording) << log.reason();
  EXPECT_GE(log.counters().events, events + 4);
  log.finish();
  for (const std::string& name : names()) {
    Result<LogReader> reader = LogReader::open(options_.directory / name);
    ASSERT_TRUE(reader.ok());
    while (reader->next().value()) {
    }
    EXPECT_EQ(reader->damages(), 0u) << name;
  }
}

// The disk is full before we look: the write itself fails.
TEST_F(RollingLogTest, AFullDiskLosesNothingThatWasWritten) {
  const SmallDisk disk(options_.directory, "8m");
  if (!disk) GTEST_SKIP() << "only root can mount a small file system";
  RollingLog log = open();
  const Bytes data(kMiB / 3, 7);
  for (int i = 0; i < 40; ++i) log.append(kEpoch_s * kSecond_us + i, "IMAGE", data, 1);
  EXPECT_EQ(log.state(), RollingLog::State::kPaused);
  EXPECT_NE(log.reason().find("No space left on device"), std::string::npos) << log.reason();
  ASSERT_EQ(names().size(), 1u);
  Result<LogReader> reader = LogReader::open(options_.directory / names().front());
  ASSERT_TRUE(reader.ok());
  std::uint64_t events = 0;
  while (reader->next().value()) ++events;
  EXPECT_GE(events, 20u);
  EXPECT_EQ(reader->damages(), 0u);
}

TEST_F(RollingLogTest, SaysWhatCannotBeMade) {
  options_.directory = "/proc/logs";
  const Result<RollingLog> log = RollingLog::open(options_);
  ASSERT_FALSE(log.ok());
  EXPECT_TRUE(log.error().message.starts_with("/proc/logs: cannot be made: "))
      << log.error().message;
}

}  // namespace
}  // namespace waymark::eventlog
