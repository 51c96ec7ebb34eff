#include "daemon/system/line_writer.h"

#include <array>
#include <chrono>
#include <cstdint>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "base/unique_fd.h"

namespace waymark::daemon {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// A pipe of one page.
struct Pipe {
  Pipe() {
    std::array<int, 2> ends{-1, -1};
    EXPECT_EQ(::pipe2(ends.data(), O_CLOEXEC), 0);
    reader = UniqueFd(ends[0]);
    writer = UniqueFd(ends[1]);
    ::fcntl(writer.get(), F_SETPIPE_SZ, 4096);
  }
  // Lines until the writers have gone.
  [[nodiscard]] std::vector<std::string> lines() {
    writer = UniqueFd();
    std::string text;
    std::array<char, 1000> bytes{};
    for (ssize_t count = 0; (count = ::read(reader.get(), bytes.data(), bytes.size())) > 0;) {
      text.append(bytes.data(), static_cast<std::size_t>(count));
    }
    std::vector<std::string> all;
    for (std::size_t at = 0; at < text.size();) {
      const std::size_t end = text.find('\n', at);
      all.push_back(text.substr(at, end - at));
      at = end == text.npos ? text.size() : end + 1;
    }
    return all;
  }

  UniqueFd reader;
  UniqueFd writer;
};

std::string lossLine(std::uint64_t lost) { return "lost " + std::to_string(lost) + "\n"; }

TEST(LineWriter, WritesEveryLineInOrder) {
  Pipe pipe;
  auto reading = std::async(std::launch::async, [&, out = pipe.writer.get()] {
    LineWriter writer(out, lossLine);
    for (int i = 0; i < 500; ++i) writer.add(std::to_string(i) + "\n");
    writer.drain();
    return writer.lost();
  });
  std::this_thread::sleep_for(milliseconds(20));
  std::array<char, 8192> bytes{};
  std::string text;
  while (text.size() < 10 * 2 + 90 * 3 + 400 * 4) {
    const ssize_t count = ::read(pipe.reader.get(), bytes.data(), bytes.size());
    ASSERT_GT(count, 0);
    text.append(bytes.data(), static_cast<std::size_t>(count));
  }
  EXPECT_EQ(reading.get(), 0U);
  EXPECT_TRUE(text.starts_with("0\n1\n2\n"));
  EXPECT_TRUE(text.ends_with("498\n499\n"));
}

// Who has something to say does not wait; what was lost is told once there is room again.
TEST(LineWriter, NobodyWaitsForAReaderThatStopped) {
  constexpr int kLines = 10'000;
  Pipe pipe;
  auto writer = std::make_unique<LineWriter>(pipe.writer.get(), lossLine,
                                             LineWriter::Options{.max_lines = 100});
  auto saying = std::async(std::launch::async, [&] {
    for (int i = 0; i < kLines; ++i) writer->add(std::string(50, 'x') + "\n");
  });
  ASSERT_EQ(saying.wait_for(seconds(20)), std::future_status::ready);
  const std::uint64_t lost = writer->lost();
  EXPECT_GT(lost, kLines - 400U);

  std::thread finishing([&] { writer.reset(); });  // writes what waits, as somebody reads
  const std::vector<std::string> lines = pipe.lines();
  finishing.join();
  ASSERT_FALSE(lines.empty());
  EXPECT_TRUE(lines.back().starts_with("lost "));
  std::uint64_t told = 0;
  std::uint64_t read = 0;
  for (const std::string& line : lines) {
    const bool tells = line.starts_with("lost ");
    told += tells ? std::stoull(line.substr(5)) : 0;
    read += tells ? 0 : 1;
  }
  EXPECT_EQ(told, lost);
  EXPECT_EQ(read + lost, static_cast<std::uint64_t>(kLines));
}

TEST(LineWriter, TheEndComesThoughNobodyReads) {
  Pipe pipe;
  auto done = std::async(std::launch::async, [&] {
    LineWriter writer(pipe.writer.get(), lossLine, {.patience = milliseconds(20)});
    for (int i = 0; i < 200; ++i) writer.add(std::string(50, 'x') + "\n");
  });
  EXPECT_EQ(done.wait_for(seconds(20)), std::future_status::ready);
}

TEST(LineWriter, AReaderThatHasGoneEndsNothing) {
  Pipe pipe;
  pipe.reader = UniqueFd();
  LineWriter writer(pipe.writer.get(), lossLine);
  for (int i = 0; i < 10; ++i) writer.add("to nobody\n");
  writer.drain();
  EXPECT_GE(writer.lost(), 10U);
}

// As when a program that shares the terminal has made it so.
TEST(LineWriter, AFileThatDoesNotWaitIsWaitedFor) {
  Pipe pipe;
  ::fcntl(pipe.writer.get(), F_SETFL, O_NONBLOCK);
  auto writer = std::make_unique<LineWriter>(pipe.writer.get(), lossLine);
  for (int i = 0; i < 200; ++i) writer->add(std::string(50, 'x') + "\n");
  std::thread finishing([&] { writer.reset(); });
  EXPECT_EQ(pipe.lines().size(), 200U);
  finishing.join();
}

}  // namespace
}  // namespace waymark::daemon
