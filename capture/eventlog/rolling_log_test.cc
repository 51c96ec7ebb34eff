#include "capture/eventlog/rolling_log.h"

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/resource.h>

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

// Once a second; the seconds at which its events began to be recorded again, and those at which
// they ceased to be.
struct Changes {
  std::vector<std::int64_t> paused_s;
  std::vector<std::int64_t> resumed_s;
  std::vector<std::string> reasons;
};

class TroubledLogTest : public RollingLogTest {
 protected:
  // Until then, with an event of 1 kB twenty times a second.
  void recordUntil(RollingLog* log, std::int64_t until_s) {
    const Bytes data(1000, 7);
    for (; tick_ < 20 * until_s; ++tick_) {
      const std::int64_t now_ns = tick_ * (kSecond_ns / 20);
      log->append(kEpoch_s * kSecond_us + now_ns / 1000, "IMAGE", data, now_ns);
      log->maintain(now_ns);
      const bool paused = log->state() == RollingLog::State::kPaused;
      if (paused != paused_) (paused ? seen_.paused_s : seen_.resumed_s).push_back(tick_ / 20);
      if (paused && (seen_.reasons.empty() || seen_.reasons.back() != log->reason())) {
        seen_.reasons.push_back(log->reason());
      }
      paused_ = paused;
    }
  }
  [[nodiscard]] std::uint64_t eventsIn(const std::string& name) const {
    return testing::countEvents(options_.directory / name);
  }

  Changes seen_;
  std::int64_t tick_ = 0;
  bool paused_ = false;
};

// As of a quota that is used up: files can be made, and nothing be put into them.
class NoBytes {
 public:
  NoBytes() {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit none = before_;
    none.rlim_cur = 0;
    setrlimit(RLIMIT_FSIZE, &none);
  }
  NoBytes(const NoBytes&) = delete;
  NoBytes& operator=(const NoBytes&) = delete;
  ~NoBytes() { setrlimit(RLIMIT_FSIZE, &before_); }

 private:
  rlimit before_{};
};

TEST_F(TroubledLogTest, WhatIsNoWantOfRoomIsTriedAgainWithGrowingPauses) {
  RollingLog log = open();
  {
    const NoBytes trouble;
    recordUntil(&log, 40);
    EXPECT_TRUE(names().empty()) << "no empty files";
  }
  EXPECT_EQ(seen_.reasons, std::vector<std::string>{options_.directory.string() +
                                                    ": cannot be written: File too large"});
  recordUntil(&log, 100);
  // 5 s, 10, 20 and 40 after one another.
  EXPECT_EQ(seen_.paused_s, std::vector<std::int64_t>{0});
  ASSERT_EQ(seen_.resumed_s.size(), 1u);
  EXPECT_NEAR(seen_.resumed_s[0], 76, 1);
  EXPECT_EQ(log.counters().pauses, 1u);
  EXPECT_EQ(log.counters().files, 1u);
  EXPECT_EQ(log.counters().events + log.counters().lost, 2000u);
  log.finish();
  ASSERT_EQ(names().size(), 1u);
  EXPECT_TRUE(names().front().ends_with("-0000.lcmlog")) << "no number is left out";
  EXPECT_EQ(eventsIn(names().front()), log.counters().events);
}

TEST_F(TroubledLogTest, WhatWasRecordedBeforeItStays) {
  options_.preamble = {{"FILE", Bytes(100, 1)}};
  RollingLog log = open();
  recordUntil(&log, 10);
  {
    const NoBytes trouble;
    recordUntil(&log, 20);
  }
  recordUntil(&log, 30);
  log.finish();
  ASSERT_EQ(names().size(), 2u);
  EXPECT_TRUE(names()[1].ends_with("-0001.lcmlog"));
  EXPECT_EQ(eventsIn(names()[0]) + eventsIn(names()[1]) + log.counters().lost, 600u + 2u)
      << "each is there, or counted";
  EXPECT_EQ(seen_.paused_s.size(), 1u);
  EXPECT_EQ(seen_.resumed_s.size(), 1u);
}

// There is room for bytes, and for no file: its becoming more changes nothing.
TEST_F(TroubledLogTest, WithoutInodes) {
  const SmallDisk disk(options_.directory, "64m,nr_inodes=4");
  if (!disk) GTEST_SKIP() << "only root can mount a small file system";
  for (const char* name : {"a", "b", "c"}) {
    testing::writeAll(options_.directory / name, Bytes(kMiB, 1));
  }
  RollingLog log = open();
  recordUntil(&log, 4);
  fs::resize_file(options_.directory / "a", 0);
  recordUntil(&log, 30);
  EXPECT_EQ(seen_.paused_s.size(), 1u);
  EXPECT_EQ(seen_.reasons.size(), 1u);
  fs::remove(options_.directory / "a");
  recordUntil(&log, 100);
  EXPECT_EQ(log.state(), RollingLog::State::kRecording) << log.reason();
  ASSERT_EQ(seen_.resumed_s.size(), 1u);
  EXPECT_NEAR(seen_.resumed_s[0], 36, 1);
}

TEST_F(TroubledLogTest, ReadOnlyForAWhile) {
  const SmallDisk disk(options_.directory, "64m");
  if (!disk) GTEST_SKIP() << "only root can mount a small file system";
  RollingLog log = open();
  ASSERT_EQ(::mount("", options_.directory.c_str(), nullptr, MS_REMOUNT | MS_RDONLY, nullptr), 0);
  recordUntil(&log, 30);
  ASSERT_EQ(::mount("", options_.directory.c_str(), nullptr, MS_REMOUNT, nullptr), 0);
  recordUntil(&log, 100);
  EXPECT_EQ(seen_.paused_s.size(), 1u);
  ASSERT_EQ(seen_.resumed_s.size(), 1u);
  EXPECT_NEAR(seen_.resumed_s[0], 36, 1);
  EXPECT_EQ(seen_.reasons, std::vector<std::string>{options_.directory.string() +
                                                    ": cannot be written: Read-only file system"});
}

// Nothing is left to others, so that the disk really is full; with the room of a few events it
// does not begin again.
TEST_F(TroubledLogTest, AFullDiskIsOneUntilThereIsRoomToSpeakOf) {
  const SmallDisk disk(options_.directory, "8m");
  if (!disk) GTEST_SKIP() << "only root can mount a small file system";
  testing::writeAll(options_.directory / "stranger", Bytes(5 * kMiB, 1));
  testing::writeAll(options_.directory / "another", Bytes(kMiB, 1));
  RollingLog log = open();
  recordUntil(&log, 200);
  EXPECT_EQ(log.state(), RollingLog::State::kPaused);
  fs::remove(options_.directory / "another");
  recordUntil(&log, 300);
  EXPECT_EQ(seen_.resumed_s, std::vector<std::int64_t>{});
  fs::remove(options_.directory / "stranger");
  recordUntil(&log, 302);
  EXPECT_EQ(seen_.resumed_s, std::vector<std::int64_t>{300}) << "at once";
  EXPECT_EQ(log.counters().pauses, 1u);
  EXPECT_EQ(log.counters().files, 2u);
}

// A computer without a clock: it begins in 1970, whatever there is of later years.
TEST_F(RollingLogTest, WhatIsRecordedNowIsTheNewestWhateverTheClockSays) {
  options_.file_bytes = 2 * kMiB;
  options_.quota_bytes = 10 * kMiB;
  {
    RollingLog log = open();
    record(&log, 10, 1);
    log.finish();
  }
  const std::vector<std::string> before = names();
  {
    RollingLog log = open();
    const Bytes data(kMiB - 100, 7);
    for (int i = 0; i < 4; ++i) log.append((12 + i) * kSecond_us, "IMAGE", data, i * kSecond_ns);
    log.finish();
  }
  const std::string first = "waymark-19700101T000012.000Z-c0001-0000.lcmlog";
  const std::string second = "waymark-19700101T000012.000Z-c0001-0001.lcmlog";
  EXPECT_TRUE(fs::exists(options_.directory / first));
  EXPECT_TRUE(fs::exists(options_.directory / second));
  EXPECT_FALSE(fs::exists(options_.directory / before[0])) << "the oldest";
  EXPECT_TRUE(fs::exists(options_.directory / before.back()));

  // The newest is cut, which the clock would call the oldest.
  Bytes torn = testing::readAll(options_.directory / second);
  torn.resize(torn.size() - 10);
  testing::writeAll(options_.directory / second, torn);
  RollingLog log = open();
  EXPECT_NE(log.repaired().find(second), std::string::npos) << log.repaired();
  // With the clock set again the order goes on.
  record(&log, 8, 1);
  log.finish();
  EXPECT_FALSE(fs::exists(options_.directory / first));
  EXPECT_EQ(names().back().substr(0, 17), "waymark-20231114T");
  EXPECT_NE(names().back().find("Z-c0001-"), std::string::npos);
}

TEST_F(RollingLogTest, WhatHasNoNameOfOursIsNobodysBusiness) {
  options_.file_bytes = 2 * kMiB;
  options_.quota_bytes = 4 * kMiB;
  fs::create_directories(options_.directory);
  for (const char* name :
       {"waymark-notes.lcmlog", "waymark-20231114T221320.000Z-0000.lcmlog.bak"}) {
    testing::writeAll(options_.directory / name, Bytes(9 * kMiB, 1));
  }
  const fs::path elsewhere = directory_ / "elsewhere";
  testing::writeAll(elsewhere, Bytes(100, 1));
  fs::create_symlink(elsewhere, options_.directory / "waymark-20231114T221320.000Z-0009.lcmlog");
  RollingLog log = open();
  EXPECT_EQ(log.repaired(), "");
  EXPECT_EQ(fs::file_size(elsewhere), 100u);
  record(&log, 10, 1);
  log.finish();
  EXPECT_TRUE(fs::exists(options_.directory / "waymark-notes.lcmlog"));
  EXPECT_TRUE(fs::exists(options_.directory / "waymark-20231114T221320.000Z-0000.lcmlog.bak"));
  EXPECT_TRUE(fs::exists(options_.directory / "waymark-20231114T221320.000Z-0009.lcmlog"));
}

// What a start reads of the log before: its end. 512 events of 2 MiB, which take no place on the
// disk; the last one is torn.
TEST_F(RollingLogTest, StartingReadsTheEndOfTheLastLogAndNotAllOfIt) {
  fs::create_directories(options_.directory);
  const fs::path last = options_.directory / "waymark-20231114T221320.000Z-0000.lcmlog";
  testing::writeSparseLog(last, 512, 2 * kMiB);
  const std::uint64_t whole = fs::file_size(last) - (2 * kMiB + kHeaderBytes + 5);
  fs::resize_file(last, fs::file_size(last) - 1000);
  const std::uint64_t before = testing::bytesRead();
  RollingLog log = open();
  EXPECT_LT(testing::bytesRead() - before, 64 * kMiB);
  EXPECT_EQ(fs::file_size(last), whole);
}

// An event that is larger than what is looked at first, then zeros as a file system leaves them.
TEST_F(RollingLogTest, FindsTheEndHoweverFarItIs) {
  fs::create_directories(options_.directory);
  const fs::path last = options_.directory / "waymark-20231114T221320.000Z-0000.lcmlog";
  testing::writeSparseLog(last, 3, 40 * kMiB);
  const std::uint64_t whole = fs::file_size(last);
  fs::resize_file(last, whole + 10 * kMiB);
  {
    RollingLog log = open();
    EXPECT_EQ(fs::file_size(last), whole);
  }
  fs::resize_file(last, 20 * kMiB);  // not even one event
  RollingLog log = open();
  EXPECT_EQ(fs::file_size(last), 0u);
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
