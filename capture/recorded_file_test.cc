#include "capture/recorded_file.h"

#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include <gtest/gtest.h>

#include "capture/eventlog/log_writer.h"
#include "tests/temporary_directory.h"

namespace waymark::capture {
namespace {

const RecordedFile kFile{RecordedFile::kConfiguration, "waymarkd.toml", "a = 1\n"};

TEST(RecordedFile, ComesBackAsItWas) {
  const auto decoded = decodeFile(encodeFile(kFile, 7));
  ASSERT_TRUE(decoded);
  EXPECT_EQ(decoded->purpose, kFile.purpose);
  EXPECT_EQ(decoded->name, kFile.name);
  EXPECT_EQ(decoded->content, kFile.content);
}

TEST(RecordedFile, DamageIsNoFile) {
  const std::vector<std::uint8_t> whole = encodeFile(kFile, 7);
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_FALSE(decodeFile(std::span(whole).first(size))) << size;
  }
  std::mt19937 random(5);
  for (int i = 0; i < 10'000; ++i) {
    std::vector<std::uint8_t> damaged = whole;
    damaged[random() % damaged.size()] ^= static_cast<std::uint8_t>(1U << (random() % 8));
    (void)decodeFile(damaged);  // whatever comes of it, nothing bad happens
  }
}

TEST(RecordedFile, ThoseThatALogBeginsWith) {
  waymark::testing::TemporaryDirectory directory;
  auto log = eventlog::LogWriter::create(directory / "a.lcmlog");
  ASSERT_TRUE(log);
  const std::vector<std::uint8_t> torn(12, 1);
  ASSERT_TRUE(log->append(1, RecordedFile::kChannel, encodeFile(kFile, 1)));
  ASSERT_TRUE(log->append(1, RecordedFile::kChannel, torn));
  ASSERT_TRUE(log->append(1, RecordedFile::kChannel,
                          encodeFile({RecordedFile::kMap, "map.json", "{}"}, 1)));
  ASSERT_TRUE(log->append(1, "CAMERA", torn));
  ASSERT_TRUE(log->append(1, RecordedFile::kChannel, encodeFile(kFile, 1)));
  ASSERT_TRUE(log->flush());
  const auto files = readRecordedFiles(directory / "a.lcmlog");
  ASSERT_TRUE(files) << files.error().message;
  ASSERT_EQ(files->size(), 2U);
  EXPECT_EQ((*files)[1].purpose, RecordedFile::kMap);
  EXPECT_FALSE(readRecordedFiles(directory / "nowhere"));
}

}  // namespace
}  // namespace waymark::capture
