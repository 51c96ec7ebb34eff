// `waymark setup` as somebody answers it at a terminal.
#include <filesystem>
#include <string>

#include <gtest/gtest.h>

#include "tests/process.h"
#include "tests/temporary_directory.h"
#include "tests/terminal.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;

constexpr const char* kAsksDictionary = "Dictionary of the markers [ARUCO_MIP_36h12]: ";
constexpr const char* kAsksSize = "Side of the printed black square, measured, metres (0.165): ";

class SetupTest : public ::testing::Test {
 protected:
  [[nodiscard]] Terminal setup() const {
    return Terminal({WAYMARK_PROGRAM, "setup", "--camera", "sim:walls", "--out", file_.string()});
  }

  const TemporaryDirectory directory_;
  const fs::path file_ = directory_ / "waymarkd.toml";
};

TEST_F(SetupTest, AsksWhatIsNotSaidAndProposesWhatIsInView) {
  Terminal terminal = setup();
  ASSERT_TRUE(terminal.shows(kAsksDictionary)) << terminal.screen();
  terminal.type("\n");
  ASSERT_TRUE(terminal.shows(kAsksSize)) << terminal.screen();
  terminal.type("\n");
  ASSERT_TRUE(terminal.shows(kAsksSize)) << "nothing can be proposed: " << terminal.screen();
  terminal.type("0.165\n");
  EXPECT_EQ(terminal.wait(), 0) << terminal.screen();
  EXPECT_TRUE(terminal.shows("waymarkd.toml is written. Next:")) << terminal.screen();
  const std::string written = readFile(file_);
  EXPECT_NE(written.find("dictionary = \"ARUCO_MIP_36h12\""), std::string::npos) << written;
  EXPECT_NE(written.find("marker_size_m = 0.165\n"), std::string::npos) << written;
  const ProgramResult checked = runProgram({WAYMARKD, "--check", "--config", file_.string()});
  EXPECT_EQ(checked.exit_code, 0) << checked.err;
}

TEST_F(SetupTest, AnAnswerThatCannotBeIsAskedForAgain) {
  Terminal terminal = setup();
  ASSERT_TRUE(terminal.shows(kAsksDictionary)) << terminal.screen();
  terminal.type("tag36h11\n");
  ASSERT_TRUE(terminal.shows("APRILTAG_36h11")) << terminal.screen();
  ASSERT_TRUE(terminal.shows(kAsksDictionary)) << terminal.screen();
  terminal.type("ARUCO_MIP_36h12\n");
  ASSERT_TRUE(terminal.shows(kAsksSize)) << terminal.screen();
  terminal.type("165\n");
  ASSERT_TRUE(terminal.shows("165 mm are 0.165")) << terminal.screen();
  ASSERT_TRUE(terminal.shows(kAsksSize)) << terminal.screen();
  terminal.type("0.165\n");
  EXPECT_EQ(terminal.wait(), 0) << terminal.screen();
  EXPECT_TRUE(fs::exists(file_));
}

TEST_F(SetupTest, WhoLeavesLeavesNothingBehind) {
  for (const bool interrupt : {false, true}) {
    Terminal terminal = setup();
    ASSERT_TRUE(terminal.shows(kAsksDictionary)) << terminal.screen();
    terminal.type(interrupt ? "\x03" : "\x04");
    EXPECT_EQ(terminal.wait(), interrupt ? -1 : 2) << terminal.screen();
    EXPECT_FALSE(fs::exists(file_));
  }
}

}  // namespace
}  // namespace waymark::testing
