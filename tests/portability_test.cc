// Loops compiled for several processors give the same bits on each: `waymark run` on this computer
// and on an emulated one that has nothing beyond SSE4.
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/process.h"
#include "tests/temporary_directory.h"

namespace waymark::testing {
namespace {

TEST(Portability, AnOlderProcessorFindsTheSameCornersAndTheSameMap) {
  const TemporaryDirectory directory;
  const auto file = [&](const std::string& name) { return (directory / name).string(); };
  const ProgramResult rendered =
      runProgram({WAYMARK_PROGRAM, "simulate", "walls", "--size", "320x240", "--marker-size", "0.2",
                  "--fps", "10", "--duration", "1.5", "--quiet", "--out", file("walls")});
  ASSERT_EQ(rendered.exit_code, 0) << rendered.err;
  const auto run = [&](std::vector<std::string> command, const std::string& name) {
    const std::vector<std::string> arguments = {WAYMARK_PROGRAM,
                                                "run",
                                                file("walls/frames.avi"),
                                                "--calibration",
                                                file("walls/calib.yml"),
                                                "--dictionary",
                                                "ARUCO_MIP_36h12",
                                                "--marker-size",
                                                "0.2",
                                                "--quiet",
                                                "--out",
                                                file(name),
                                                "--save-detections",
                                                file(name + "/detections.csv")};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const ProgramResult result = runProgram(command);
    ASSERT_EQ(result.exit_code, 0) << result.err;
  };
  run({}, "here");
  run({QEMU_X86_64, "-cpu", "Nehalem"}, "there");
  for (const char* name : {"/detections.csv", "/map.json", "/trajectory.tum"}) {
    const std::string here = readFile(file("here") + name);
    EXPECT_GT(here.size(), 500U) << name;
    EXPECT_TRUE(here == readFile(file("there") + name)) << name;
  }
}

}  // namespace
}  // namespace waymark::testing
