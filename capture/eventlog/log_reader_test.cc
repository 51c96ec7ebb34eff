#include "capture/eventlog/log_reader.h"

#include <algorithm>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "base/clock.h"
#include "capture/eventlog/testing_log.h"
#include "tests/temporary_directory.h"

namespace waymark::eventlog {
namespace {

using testing::Bytes;
using testing::numbersWithout;
using testing::ReadBack;

constexpr int kEvents = 40;

class LogReaderTest : public ::testing::Test {
 protected:
  LogReaderTest() : begins_(testing::writeLog(directory_ / "a.lcmlog", kEvents)) {
    bytes_ = testing::readAll(directory_ / "a.lcmlog");
  }
  [[nodiscard]] ReadBack read() const {
    testing::writeAll(directory_ / "b.lcmlog", bytes_);
    return testing::readBack(directory_ / "b.lcmlog");
  }
  std::uint8_t& at(std::uint64_t offset) { return bytes_[static_cast<std::size_t>(offset)]; }
  [[nodiscard]] std::uint64_t begin(int event) const {
    return begins_[static_cast<std::size_t>(event)];
  }

  waymark::testing::TemporaryDirectory directory_;
  std::vector<std::uint64_t> begins_;
  Bytes bytes_;
};

TEST_F(LogReaderTest, AWholeLogIsReadWhole) {
  const ReadBack log = read();
  EXPECT_EQ(log.numbers, numbersWithout(kEvents, {}));
  EXPECT_TRUE(log.all_as_written);
  EXPECT_EQ(log.damages, 0u);
}

TEST_F(LogReaderTest, CutOffAnywhereAllWholeEventsAreThere) {
  for (std::size_t cut = bytes_.size(); cut-- > 0; cut -= std::min<std::size_t>(cut, 97)) {
    bytes_.resize(cut);
    const auto whole = std::ranges::upper_bound(begins_, cut) - begins_.begin() - 1;
    const ReadBack log = read();
    ASSERT_EQ(log.numbers, numbersWithout(static_cast<int>(whole), {})) << "cut at " << cut;
    ASSERT_TRUE(log.all_as_written);
    ASSERT_EQ(log.damaged_bytes, cut - begin(static_cast<int>(whole)));
  }
}

// What a log costs is its bytes, not its events times a window of them.
TEST(LogReader, SmallEventsCostLittle) {
  const waymark::testing::TemporaryDirectory directory;
  constexpr int kMany = 20'000;
  {
    Result<LogWriter> writer = LogWriter::create(directory / "small.lcmlog");
    ASSERT_TRUE(writer.ok());
    const Bytes data(60);
    for (int i = 0; i < kMany; ++i) ASSERT_TRUE(writer->append(i, "SMALL", data).ok());
    ASSERT_TRUE(writer->flush().ok());
  }
  Result<LogReader> reader = LogReader::open(directory / "small.lcmlog");
  ASSERT_TRUE(reader.ok());
  const std::int64_t begin_ns = threadCpuNs();
  int events = 0;
  for (auto event = reader->next(); event.ok() && *event; event = reader->next()) ++events;
  EXPECT_EQ(events, kMany);
  EXPECT_LT(threadCpuNs() - begin_ns, 2'000'000'000);  // some milliseconds; it was 12 s
}

// What file systems make of a power cut: the length is there, the data are not.
TEST_F(LogReaderTest, ATailOfZerosCostsNothingBeforeIt) {
  bytes_.resize(bytes_.size() + 100'000, 0);
  const ReadBack log = read();
  EXPECT_EQ(log.numbers, numbersWithout(kEvents, {}));
  EXPECT_EQ(log.damages, 1u);
  EXPECT_EQ(log.damaged_bytes, 100'000u);
}

TEST_F(LogReaderTest, ABadSyncWordCostsOneEvent) {
  at(begin(7)) ^= 0x10;
  const ReadBack log = read();
  EXPECT_EQ(log.numbers, numbersWithout(kEvents, {7}));
  EXPECT_TRUE(log.all_as_written);
  EXPECT_EQ(log.damages, 1u);
  EXPECT_EQ(log.damaged_bytes, begin(8) - begin(7));
}

TEST_F(LogReaderTest, WrongLengthsCostOneEvent) {
  const std::vector<std::pair<int, std::uint8_t>> flips = {{20, 0x80}, {23, 0x01}, {23, 0x20},
                                                           {24, 0x80}, {25, 0x01}, {26, 0x01},
                                                           {27, 0x01}, {27, 0x80}};
  for (const auto& [byte, bit] : flips) {
    at(begin(12) + static_cast<unsigned>(byte)) ^= bit;
    const ReadBack log = read();
    EXPECT_EQ(log.numbers, numbersWithout(kEvents, {12})) << byte << " " << int{bit};
    EXPECT_TRUE(log.all_as_written);
    at(begin(12) + static_cast<unsigned>(byte)) ^= bit;
  }
}

TEST_F(LogReaderTest, AStretchOfJunkCostsWhatItCovers) {
  for (std::uint64_t i = begin(5) + 3; i < begin(9) + 10; ++i) at(i) = 0x5a;
  const ReadBack log = read();
  EXPECT_EQ(log.numbers, numbersWithout(kEvents, {5, 6, 7, 8, 9}));
  EXPECT_TRUE(log.all_as_written);
}

// Data may hold anything, also what looks like an event.
TEST_F(LogReaderTest, ALogWithinALogIsData) {
  Result<LogWriter> writer = LogWriter::create(directory_ / "outer.lcmlog");
  ASSERT_TRUE(writer.ok());
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(writer->append(i, "INNER", bytes_).ok());
  ASSERT_TRUE(writer->flush().ok());
  Result<LogReader> reader = LogReader::open(directory_ / "outer.lcmlog");
  ASSERT_TRUE(reader.ok());
  for (int i = 0; i < 3; ++i) {
    const Result<std::optional<Event>> event = reader->next();
    ASSERT_TRUE(event.ok() && *event);
    EXPECT_EQ((*event)->number, i);
    EXPECT_TRUE(std::ranges::equal((*event)->data, bytes_));
  }
  EXPECT_EQ(reader->damages(), 0u);
}

// Any bytes altered, dropped or put in: no crash, no end without an end, and what is far from the
// damage is there.
TEST_F(LogReaderTest, AnyDamageCostsLittle) {
  const Bytes whole = bytes_;
  std::mt19937 random(3);
  for (int round = 0; round < 10'000; ++round) {
    bytes_ = whole;
    const std::size_t place = random() % bytes_.size();
    const auto where = bytes_.begin() + static_cast<std::ptrdiff_t>(place);
    const std::size_t count = std::min<std::size_t>(random() % 200, bytes_.size() - place);
    switch (random() % 3) {
      case 0:
        for (std::size_t i = 0; i < count; ++i) {
          bytes_[place + i] = static_cast<std::uint8_t>(random());
        }
        break;
      case 1:
        bytes_.erase(where, where + static_cast<std::ptrdiff_t>(count));
        break;
      default:
        bytes_.insert(where, count, static_cast<std::uint8_t>(random()));
    }
    const ReadBack log = read();
    ASSERT_GE(log.numbers.size() + 6, kEvents) << "round " << round;
    ASSERT_TRUE(std::ranges::is_sorted(log.numbers)) << "round " << round;
  }
}

TEST(LogReader, NamesWhatCannotBeRead) {
  EXPECT_EQ(LogReader::open("/nowhere.lcmlog").error().message,
            "/nowhere.lcmlog: cannot be read: No such file or directory");
  EXPECT_EQ(LogReader::open("/").error().message, "/: is no file");
}

TEST(LogReader, NothingIsALogWithoutEvents) {
  const waymark::testing::TemporaryDirectory directory;
  testing::writeAll(directory / "empty.lcmlog", {});
  EXPECT_TRUE(testing::readBack(directory / "empty.lcmlog").numbers.empty());
}

}  // namespace
}  // namespace waymark::eventlog
