#include "capture/eventlog/log_writer.h"

#include <cstdint>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <lcm/eventlog.h>

#include "capture/eventlog/testing_log.h"
#include "tests/temporary_directory.h"

namespace waymark::eventlog {
namespace {

using testing::Bytes;

class LogWriterTest : public ::testing::Test {
 protected:
  waymark::testing::TemporaryDirectory directory_;
  std::filesystem::path file_ = directory_ / "a.lcmlog";
};

// LCM's own tools read what we write.
TEST_F(LogWriterTest, LcmReadsIt) {
  testing::writeLog(file_, 50);
  lcm_eventlog_t* log = lcm_eventlog_create(file_.c_str(), "r");
  ASSERT_NE(log, nullptr);
  for (int i = 0; i < 50; ++i) {
    lcm_eventlog_event_t* event = lcm_eventlog_read_next_event(log);
    ASSERT_NE(event, nullptr) << i;
    EXPECT_EQ(event->eventnum, i);
    EXPECT_EQ(event->timestamp, 1'000'000 + i);
    EXPECT_EQ(std::string(event->channel), "CHANNEL_" + std::to_string(i % 3));
    const auto* data = static_cast<const std::uint8_t*>(event->data);
    EXPECT_EQ(Bytes(data, data + event->datalen), testing::payload(i));
    lcm_eventlog_free_event(event);
  }
  EXPECT_EQ(lcm_eventlog_read_next_event(log), nullptr);
  lcm_eventlog_destroy(log);
}

// And we what LCM writes.
TEST_F(LogWriterTest, LcmsOwnLogsAreRead) {
  lcm_eventlog_t* log = lcm_eventlog_create(file_.c_str(), "w");
  ASSERT_NE(log, nullptr);
  for (int i = 0; i < 20; ++i) {
    Bytes data = testing::payload(i);
    std::string channel = "CHANNEL_" + std::to_string(i % 3);
    lcm_eventlog_event_t event{};
    event.timestamp = 1'000'000 + i;
    event.channellen = static_cast<std::int32_t>(channel.size());
    event.datalen = static_cast<std::int32_t>(data.size());
    event.channel = channel.data();
    event.data = data.data();
    ASSERT_EQ(lcm_eventlog_write_event(log, &event), 0);
  }
  lcm_eventlog_destroy(log);
  const testing::ReadBack read = testing::readBack(file_);
  EXPECT_EQ(read.numbers.size(), 20u);
  EXPECT_TRUE(read.all_as_written);
  EXPECT_EQ(read.damages, 0u);
}

TEST_F(LogWriterTest, WhatWasFlushedIsThereWhateverComesAfter) {
  Result<LogWriter> writer = LogWriter::create(file_);
  ASSERT_TRUE(writer.ok());
  for (int i = 0; i < 5; ++i) ASSERT_TRUE(writer->append(1'000'000 + i, "C", Bytes(3, 1)).ok());
  ASSERT_TRUE(writer->flush().ok());
  ASSERT_TRUE(writer->append(1'000'005, "C", Bytes(3, 1)).ok());  // not flushed
  EXPECT_EQ(testing::readBack(file_).numbers.size(), 5u);
}

// Events larger than a block, flushed at any place within it.
TEST_F(LogWriterTest, LargeEventsAcrossBlocks) {
  Result<LogWriter> writer = LogWriter::create(file_);
  ASSERT_TRUE(writer.ok());
  std::uint64_t total = 0;
  for (int i = 0; i < 9; ++i) {
    const Bytes data(LogWriter::kBlockBytes * static_cast<std::size_t>(i) / 3, std::uint8_t(i));
    ASSERT_TRUE(writer->append(i, "LARGE", data).ok());
    total += kHeaderBytes + 5 + data.size();
    if (i % 2 == 0) {
      ASSERT_TRUE(writer->flush().ok());
    }
  }
  ASSERT_TRUE(writer->flush().ok());
  EXPECT_EQ(writer->bytes(), total);
  EXPECT_EQ(std::filesystem::file_size(file_), total);
  Result<LogReader> reader = LogReader::open(file_);
  ASSERT_TRUE(reader.ok());
  for (int i = 0; i < 9; ++i) {
    const Result<std::optional<Event>> event = reader->next();
    ASSERT_TRUE(event.ok() && *event) << i;
    ASSERT_EQ((*event)->data.size(), LogWriter::kBlockBytes * static_cast<std::size_t>(i) / 3);
    for (const std::uint8_t byte : (*event)->data) ASSERT_EQ(byte, i);
  }
  EXPECT_EQ(reader->damages(), 0u);
}

TEST_F(LogWriterTest, NeverOverwrites) {
  testing::writeLog(file_, 1);
  const Result<LogWriter> again = LogWriter::create(file_);
  ASSERT_FALSE(again.ok());
  EXPECT_EQ(again.error().message, file_.string() + ": cannot be written: File exists");
}

}  // namespace
}  // namespace waymark::eventlog
