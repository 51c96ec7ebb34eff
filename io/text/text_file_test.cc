#include "io/text/text_file.h"

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/decimal_seconds.h"
#include "io/text/number_text.h"
#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

namespace fs = std::filesystem;
using waymark::testing::TemporaryDirectory;

std::size_t entries(const fs::path& directory) {
  return static_cast<std::size_t>(
      std::distance(fs::directory_iterator(directory), fs::directory_iterator()));
}

TEST(TextFile, WritesReplacesAndReads) {
  const TemporaryDirectory directory;
  for (const std::string& content :
       {std::string("first"), std::string(200'000, 'x'), std::string()}) {
    ASSERT_TRUE(writeTextFile(directory / "a.txt", content).ok());
    EXPECT_EQ(readTextFile(directory / "a.txt").value(), content);
    EXPECT_EQ(entries(directory.path()), 1U);
  }
}

TEST(TextFile, FailureNamesTheFileAndLeavesNothing) {
  const TemporaryDirectory directory;
  fs::create_directory(directory / "taken");
  const Status status = writeTextFile(directory / "taken", "content");
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().message.find("taken: cannot be written: "), std::string::npos);
  EXPECT_EQ(entries(directory.path()), 1U);
  EXPECT_FALSE(readTextFile(directory / "missing").ok());
}

TEST(TextFile, KeepsThePreviousOne) {
  const TemporaryDirectory directory;
  const fs::path file = directory / "a.txt";
  const fs::path previous = directory / "a.txt.previous";
  ASSERT_TRUE(writeTextFileKeeping(file, "one", previous));
  EXPECT_EQ(entries(directory.path()), 1U);
  ASSERT_TRUE(writeTextFileKeeping(file, "two", previous));
  EXPECT_EQ(readTextFile(file).value(), "two");
  EXPECT_EQ(readTextFile(previous).value(), "one");
  // A link that a power cut left behind is in nobody's way.
  fs::create_hard_link(file, previous.string() + ".tmp");
  ASSERT_TRUE(writeTextFileKeeping(file, "three", previous));
  EXPECT_EQ(readTextFile(file).value(), "three");
  EXPECT_EQ(readTextFile(previous).value(), "two");
  EXPECT_EQ(entries(directory.path()), 2U);
}

TEST(TextFile, WhenKeepingFailsBothStayAsTheyWere) {
  const TemporaryDirectory directory;
  const fs::path file = directory / "a.txt";
  ASSERT_TRUE(writeTextFile(file, "one"));
  fs::create_directory(directory / "previous");
  fs::create_directory(directory / "previous" / "taken");
  const Status status = writeTextFileKeeping(file, "two", directory / "previous");
  ASSERT_FALSE(status);
  EXPECT_NE(status.error().message.find("previous: cannot be written: "), std::string::npos);
  EXPECT_EQ(readTextFile(file).value(), "one");
  EXPECT_EQ(entries(directory.path()), 2U);
}

TEST(TextFile, WritesWhereALinkPoints) {
  const TemporaryDirectory directory;
  fs::create_directory(directory / "there");
  fs::create_symlink("there/target.txt", directory / "link.txt");
  fs::create_symlink("link.txt", directory / "second.txt");
  ASSERT_TRUE(writeTextFile(directory / "second.txt", "one")) << "to a file that is not there yet";
  EXPECT_TRUE(fs::is_symlink(directory / "link.txt"));
  EXPECT_TRUE(fs::is_symlink(directory / "second.txt"));
  EXPECT_EQ(readTextFile(directory / "there" / "target.txt").value(), "one");
  ASSERT_TRUE(writeTextFileKeeping(directory / "link.txt", "two", directory / "before.txt"));
  EXPECT_EQ(readTextFile(directory / "there" / "target.txt").value(), "two");
  EXPECT_EQ(readTextFile(directory / "before.txt").value(), "one");
  EXPECT_EQ(entries(directory / "there"), 1U) << "no temporary file stays";
  fs::create_symlink("round", directory / "round");
  EXPECT_FALSE(writeTextFile(directory / "round", "three"));
}

// As root, a device node was replaced by a file.
TEST(TextFile, NothingButRegularFilesIsReplaced) {
  const TemporaryDirectory directory;
  const fs::path pipe = directory / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  const fs::path link = directory / "link";
  fs::create_symlink("/dev/null", link);
  for (const fs::path& path : {pipe, link, fs::path("/dev/null")}) {
    const Status written = writeTextFile(path, "content");
    ASSERT_FALSE(written) << path;
    EXPECT_EQ(written.error().message,
              path.string() + ": cannot be written: there is something else than a regular file");
  }
  ASSERT_TRUE(writeTextFile(directory / "file", "one"));
  EXPECT_FALSE(writeTextFileKeeping(directory / "file", "two", pipe));
  EXPECT_EQ(readTextFile(directory / "file").value(), "one");
  EXPECT_EQ(fs::status(pipe).type(), fs::file_type::fifo);
  EXPECT_EQ(entries(directory.path()), 3U);
}

// In a directory in which others write, too: a name that was foreseen leads nowhere.
TEST(TextFile, TemporariesAreNobodyElses) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(writeTextFile(directory / "victim", "untouched"));
  for (const char* ending : {".tmp", ".0.tmp", ".1.tmp"}) {
    const std::string name = ".a.txt." + std::to_string(::getpid()) + ending;
    fs::create_symlink("victim", directory / name);
  }
  ASSERT_TRUE(writeTextFile(directory / "a.txt", "content"));
  EXPECT_EQ(readTextFile(directory / "victim").value(), "untouched");
  EXPECT_EQ(readTextFile(directory / "a.txt").value(), "content");
  EXPECT_FALSE(fs::is_symlink(directory / "a.txt"));
}

TEST(TextFile, ReadsNoMoreThanAsked) {
  const TemporaryDirectory directory;
  const fs::path file = directory / "large";
  ASSERT_TRUE(writeTextFile(file, std::string(std::size_t{2} << 20U, 'x')));
  EXPECT_TRUE(readTextFile(file, std::size_t{2} << 20U));
  fs::resize_file(file, std::uintmax_t{3} << 30U);
  const Result<std::string> text = readTextFile(file, std::size_t{2} << 20U);
  ASSERT_FALSE(text);
  EXPECT_EQ(text.error().message, file.string() + ": is larger than 2 MiB");
}

TEST(OutputDirectory, WhatFitsIsWritten) {
  const TemporaryDirectory directory;
  Result<OutputDirectory> output = OutputDirectory::open(directory.path());
  ASSERT_TRUE(output.ok());
  output->add("one", "1");
  output->add("missing/two", "2");
  output->add("three", "3");
  ASSERT_FALSE(output->commit());
  output->add("one", "replaced");
  EXPECT_EQ(output->commitWhatFits(), std::vector<std::string>{"missing/two"});
  EXPECT_EQ(readTextFile(directory / "one").value(), "replaced");
  EXPECT_EQ(readTextFile(directory / "three").value(), "3");
  EXPECT_EQ(entries(directory.path()), 2U);
}

TEST(OutputDirectory, WritesAllOnCommit) {
  const TemporaryDirectory directory;
  {
    Result<OutputDirectory> output = OutputDirectory::open(directory / "a" / "b");
    ASSERT_TRUE(output.ok()) << output.error().message;
    output->add("one", "1");
    output->add("two", "2");
    EXPECT_EQ(entries(directory / "a" / "b"), 0U);
    ASSERT_TRUE(output->commit().ok());
  }
  EXPECT_EQ(readTextFile(directory / "a" / "b" / "one").value(), "1");
  EXPECT_EQ(readTextFile(directory / "a" / "b" / "two").value(), "2");
  EXPECT_EQ(entries(directory / "a" / "b"), 2U);
}

TEST(OutputDirectory, EarlierResultsAreKeptOnce) {
  const TemporaryDirectory directory;
  const auto write = [&](const std::string& content, const std::vector<std::string>& names) {
    Result<OutputDirectory> output = OutputDirectory::open(directory.path());
    ASSERT_TRUE(output) << output.error().message;
    output->keepEarlierIn("previous", [](const std::string& n) { return n.starts_with("part"); });
    for (const std::string& name : names) output->add(name, content);
    const Status written = output->commit();
    ASSERT_TRUE(written) << written.error().message;
  };
  std::ofstream(directory / "notes.txt") << "mine";
  write("one", {"map", "part1", "part2"});
  EXPECT_FALSE(fs::exists(directory / "previous")) << "there was nothing to keep";
  write("two", {"map", "part1"});
  EXPECT_EQ(*readTextFile(directory / "map"), "two");
  EXPECT_FALSE(fs::exists(directory / "part2")) << "of the results before";
  EXPECT_EQ(*readTextFile(directory / "previous" / "map"), "one");
  EXPECT_EQ(*readTextFile(directory / "previous" / "part2"), "one");
  write("three", {"map"});
  EXPECT_EQ(*readTextFile(directory / "previous" / "map"), "two");
  EXPECT_FALSE(fs::exists(directory / "previous" / "part2"));
  EXPECT_EQ(*readTextFile(directory / "notes.txt"), "mine");

  fs::remove(directory / "map");
  std::ofstream(directory / "elsewhere") << "old";
  fs::create_symlink("elsewhere", directory / "map");
  write("four", {"map"});
  EXPECT_TRUE(fs::is_symlink(directory / "map"));
  EXPECT_EQ(*readTextFile(directory / "elsewhere"), "four");
}

TEST(OutputDirectory, WithoutCommitNothingIsLeft) {
  const TemporaryDirectory directory;
  {
    Result<OutputDirectory> output = OutputDirectory::open(directory / "a" / "b");
    ASSERT_TRUE(output.ok());
    output->add("one", "1");
  }
  EXPECT_EQ(entries(directory.path()), 0U);
}

TEST(OutputDirectory, FailedCommitLeavesNoFile) {
  const TemporaryDirectory directory;
  Result<OutputDirectory> output = OutputDirectory::open(directory.path());
  ASSERT_TRUE(output.ok());
  output->add("one", "1");
  output->add("missing/two", "2");
  EXPECT_FALSE(output->commit().ok());
  EXPECT_EQ(entries(directory.path()), 0U);
}

TEST(OutputDirectory, PlacesThatCannotBeWrittenAreFoundAtOnce) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(writeTextFile(directory / "file", "").ok());
  for (const fs::path& path :
       {directory / "file", directory / "file/below", fs::path("/proc/here")}) {
    const Result<OutputDirectory> output = OutputDirectory::open(path);
    ASSERT_FALSE(output.ok()) << path;
    EXPECT_EQ(output.error().message.rfind(path.string() + ": output directory cannot be", 0), 0U)
        << output.error().message;
  }
}

TEST(DecimalSeconds, AreExact) {
  EXPECT_EQ(parseSeconds("1560889276.319020123"), 1560889276319020123);
  EXPECT_EQ(parseSeconds("1.560889276319020123e+09"), 1560889276319020123);
  EXPECT_EQ(parseSeconds("-0.000000001"), -1);
  EXPECT_EQ(parseSeconds("2"), 2'000'000'000);
  EXPECT_EQ(parseSeconds(".5"), 500'000'000);
  EXPECT_EQ(parseSeconds("25e-3"), 25'000'000);
  EXPECT_EQ(parseSeconds("0.0000000014"), 1);
  EXPECT_EQ(parseSeconds("0.0000000015"), 2);
  EXPECT_EQ(parseSeconds("4611686018"), 4611686018000000000);
  for (const char* bad :
       {"", ".", "-", "1.2.3", "1e", "1e+", "0x10", "nan", "inf", "1 2", "4611686019", "-1e99"}) {
    EXPECT_FALSE(parseSeconds(bad).has_value()) << bad;
  }
  for (const std::int64_t time_ns : {0L, 1L, -1L, 1560889276319020123L, -2'500'000'000L}) {
    EXPECT_EQ(parseSeconds(formatSeconds(time_ns)), time_ns) << formatSeconds(time_ns);
  }
  EXPECT_EQ(formatSeconds(-2'500'000'000), "-2.500000000");
}

TEST(NumberText, FixedHasNoNegativeZero) {
  EXPECT_EQ(fixed(-1e-9, 3), "0.000");
  EXPECT_EQ(fixed(-0.0015, 3), "-0.002");
  EXPECT_EQ(fixed(12.5, 1), "12.5");
}

TEST(NumberText, NumbersMustBeWholeAndFinite) {
  EXPECT_EQ(parseDouble("-1.5e3"), -1500.0);
  for (const char* bad : {"", "nan", "inf", "1,5", "1.5x", "--1", "1e999"}) {
    EXPECT_FALSE(parseDouble(bad).has_value()) << bad;
  }
  EXPECT_EQ(parseInteger("-7"), -7);
  EXPECT_FALSE(parseInteger("7.0").has_value());
}

TEST(NumberText, SplitJoinsBlanksButNotCommas) {
  EXPECT_EQ(split("a \t b  c", ' ').size(), 3U);
  EXPECT_EQ(split("a,,b", ',').size(), 3U);
}

}  // namespace
}  // namespace waymark::io
