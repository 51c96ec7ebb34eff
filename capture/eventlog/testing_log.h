// Logs made for tests, and what a reader makes of them. Tests only.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "capture/eventlog/log_reader.h"
#include "capture/eventlog/log_writer.h"

namespace waymark::eventlog::testing {

using Bytes = std::vector<std::uint8_t>;

inline Bytes readAll(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

inline void writeAll(const std::filesystem::path& file, const Bytes& bytes) {
  std::ofstream out(file, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()),
            static_cast<std::streamsize>(bytes.size()));
}

// What event `number` of a test's log carries: of any length, and of any bytes.
inline Bytes payload(std::int64_t number, std::size_t most = 3000) {
  std::mt19937 random(static_cast<unsigned>(number) + 17);
  Bytes data(random() % most);
  for (std::uint8_t& byte : data) byte = static_cast<std::uint8_t>(random());
  return data;
}

// A log of `count` events; where each begins, and the end.
inline std::vector<std::uint64_t> writeLog(const std::filesystem::path& file, int count) {
  Result<LogWriter> writer = LogWriter::create(file);
  EXPECT_TRUE(writer.ok()) << writer.error().message;
  std::vector<std::uint64_t> begins;
  for (int i = 0; i < count; ++i) {
    begins.push_back(writer->bytes());
    const Bytes data = payload(i);
    EXPECT_TRUE(writer->append(1'000'000 + i, "CHANNEL_" + std::to_string(i % 3), data).ok());
  }
  begins.push_back(writer->bytes());
  EXPECT_TRUE(writer->flush().ok());
  return begins;
}

struct ReadBack {
  std::vector<std::int64_t> numbers;
  std::uint64_t damages = 0;
  std::uint64_t damaged_bytes = 0;
  bool all_as_written = true;  // each event handed out
};

inline ReadBack readBack(const std::filesystem::path& file) {
  ReadBack result;
  Result<LogReader> reader = LogReader::open(file);
  EXPECT_TRUE(reader.ok()) << reader.error().message;
  for (;;) {
    const Result<std::optional<Event>> event = reader->next();
    EXPECT_TRUE(event.ok()) << event.error().message;
    if (!event.ok() || !*event) break;
    const std::int64_t number = (*event)->number;
    result.numbers.push_back(number);
    const Bytes data((*event)->data.begin(), (*event)->data.end());
    result.all_as_written &= data == payload(number) && (*event)->utime == 1'000'000 + number &&
                             (*event)->channel == "CHANNEL_" + std::to_string(number % 3);
  }
  result.damages = reader->damages();
  result.damaged_bytes = reader->damagedBytes();
  return result;
}

// Events of zeros in a file with holes, which takes little place on the disk.
inline void writeSparseLog(const std::filesystem::path& file, int count, std::size_t data_bytes) {
  std::ofstream out(file, std::ios::binary);
  const std::string channel = "IMAGE";
  std::uint64_t begin = 0;
  for (int i = 0; i < count; ++i) {
    Bytes header(kHeaderBytes);
    writeHeader({.number = i,
                 .utime = 1'000'000 + i,
                 .channel_bytes = channel.size(),
                 .data_bytes = data_bytes},
                header);
    out.seekp(static_cast<std::streamoff>(begin));
    out.write(reinterpret_cast<const char*>(header.data()), kHeaderBytes);
    out << channel;
    begin += kHeaderBytes + channel.size() + data_bytes;
  }
  out.close();
  std::filesystem::resize_file(file, begin);
}

// Whole events; there must be no damage.
inline std::uint64_t countEvents(const std::filesystem::path& file) {
  Result<LogReader> reader = LogReader::open(file);
  EXPECT_TRUE(reader.ok()) << reader.error().message;
  std::uint64_t count = 0;
  while (reader->next().value()) ++count;
  EXPECT_EQ(reader->damages(), 0U) << file;
  return count;
}

// By this process up to now.
inline std::uint64_t bytesRead() {
  std::ifstream io("/proc/self/io");
  std::string name;
  std::uint64_t bytes = 0;
  io >> name >> bytes;
  EXPECT_EQ(name, "rchar:");
  return bytes;
}

// 0, 1, ... count - 1 without those of `without`.
inline std::vector<std::int64_t> numbersWithout(int count,
                                                const std::vector<std::int64_t>& without) {
  std::vector<std::int64_t> numbers;
  for (std::int64_t i = 0; i < count; ++i) {
    if (std::ranges::find(without, i) == without.end()) numbers.push_back(i);
  }
  return numbers;
}

}  // namespace waymark::eventlog::testing
