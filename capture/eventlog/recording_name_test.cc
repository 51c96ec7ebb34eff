#include "capture/eventlog/recording_name.h"

#include <gtest/gtest.h>

namespace waymark::eventlog {
namespace {

TEST(RecordingName, SaysWhenItBegan) {
  EXPECT_EQ(recordingName("waymark", 1'700'000'000'007'999), "waymark-20231114T221320.007Z");
  EXPECT_EQ(fileName("waymark-20231114T221320.007Z", 3),
            "waymark-20231114T221320.007Z-0003.lcmlog");
}

TEST(RecordingName, TheNextFileIsKnown) {
  EXPECT_EQ(nextFile("/a/b-0000.lcmlog"), "/a/b-0001.lcmlog");
  EXPECT_EQ(nextFile("c-d-0999.lcmlog"), "c-d-1000.lcmlog");
}

TEST(RecordingName, TheOrderIsThatOfTheCounterThenOfTime) {
  const char* const names[] = {
      "w-20231114T221320.007Z-0000.lcmlog",       "w-20231114T221320.007Z-0001.lcmlog",
      "w-20261114T221320.007Z-0000.lcmlog",       "w-19700101T000012.000Z-c0001-0000.lcmlog",
      "w-20231114T221320.007Z-c0001-0000.lcmlog", "w-19700101T000003.000Z-c0002-0000.lcmlog"};
  std::optional<FileAge> before;
  for (const char* name : names) {
    const std::optional<FileAge> age = fileAge("w", name);
    ASSERT_TRUE(age) << name;
    EXPECT_TRUE(!before || *before < *age) << name;
    before = age;
  }
}

TEST(RecordingName, OnlyOursHaveAnAge) {
  for (const char* name :
       {"", "w-", "w-.lcmlog", "w-notes.lcmlog", "w-20231114T221320.007Z.lcmlog",
        "w-20231114T221320.007Z-000.lcmlog", "w-20231114T221320.007Z-c001-0000.lcmlog",
        "w-20231114T221320,007Z-0000.lcmlog", "x-20231114T221320.007Z-0000.lcmlog",
        "w-20231114T221320.007Z-0000.lcmlog.bak", "w-2023x114T221320.007Z-0000.lcmlog"}) {
    EXPECT_FALSE(fileAge("w", name)) << name;
  }
}

TEST(RecordingName, TheNextOneIsTheNewest) {
  const auto age = [](const std::string& name) { return fileAge("w", name + "-0003.lcmlog"); };
  EXPECT_EQ(nextRecording("w", 12'000'000, std::nullopt), "w-19700101T000012.000Z");
  EXPECT_EQ(nextRecording("w", 1'700'000'000'007'000, age("w-19700101T000012.000Z")),
            "w-20231114T221320.007Z");
  EXPECT_EQ(nextRecording("w", 12'000'000, age("w-20231114T221320.007Z")),
            "w-19700101T000012.000Z-c0001");
  EXPECT_EQ(nextRecording("w", 1'700'000'000'007'000, age("w-19700101T000012.000Z-c0001")),
            "w-20231114T221320.007Z-c0001");
  EXPECT_EQ(nextFile("w-19700101T000012.000Z-c0001-0003.lcmlog"),
            "w-19700101T000012.000Z-c0001-0004.lcmlog");
}

TEST(RecordingName, OthersHaveNone) {
  for (const char* name : {"", "a.lcmlog", "a-1.lcmlog", "a0001.lcmlog", "a-0001.log", "a-0001",
                           "-0001.lcmlog", "a-00x1.lcmlog", "a-9999.lcmlog"}) {
    EXPECT_EQ(nextFile(name), "") << name;
  }
}

}  // namespace
}  // namespace waymark::eventlog
