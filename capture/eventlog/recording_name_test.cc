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

TEST(RecordingName, OthersHaveNone) {
  for (const char* name : {"", "a.lcmlog", "a-1.lcmlog", "a0001.lcmlog", "a-0001.log", "a-0001",
                           "-0001.lcmlog", "a-00x1.lcmlog", "a-9999.lcmlog"}) {
    EXPECT_EQ(nextFile(name), "") << name;
  }
}

}  // namespace
}  // namespace waymark::eventlog
