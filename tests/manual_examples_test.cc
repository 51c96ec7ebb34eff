// The commands of waymark(1), run as they are written.
#include <cctype>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/process.h"
#include "tests/temporary_directory.h"

namespace waymark::testing {
namespace {

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  for (auto at = text.find(what); at != std::string::npos; at = text.find(what, at + by.size())) {
    text.replace(at, what.size(), by);
  }
  return text;
}

// Lines that begin with "waymark " and a word, continued behind "\e" at their end, without troff's
// escapes.
std::vector<std::string> commands() {
  std::ifstream page(WAYMARK_MANUAL);
  std::vector<std::string> found;
  bool goes_on = false;
  for (std::string line; std::getline(page, line);) {
    if (goes_on) {
      found.back() += line;
    } else if (line.starts_with("waymark ") && !line.starts_with("waymark \\-")) {
      found.push_back(line);
    } else {
      continue;
    }
    goes_on = found.back().ends_with("\\e");
    if (goes_on) found.back().erase(found.back().size() - 2);
  }
  for (std::string& command : found) command = replaced(command, "\\-", "-");
  return found;
}

TEST(Manual, EveryExampleDoesWhatItSays) {
  const TemporaryDirectory directory;
  int run = 0;
  int need_a_camera = 0;
  for (const std::string& command : commands()) {
    if (command.find("video.avi") != std::string::npos) {
      ++need_a_camera;
      continue;
    }
    const ProgramResult result =
        runProgram({"sh", "-c",
                    "cd " + directory.path().string() + " && exec " WAYMARK_PROGRAM +
                        command.substr(std::string("waymark").size())});
    EXPECT_EQ(result.exit_code, 0) << command << "\n" << result.err;
    ++run;
  }
  EXPECT_EQ(need_a_camera, 2) << "doctor and run of a recording that nobody has";
  EXPECT_EQ(run, 5);
  EXPECT_GT(std::filesystem::file_size(directory / "markers.pdf"), 1000U);
  EXPECT_TRUE(std::filesystem::exists(directory / "result" / "trajectory_final.tum"));
}

// Every subcommand is in the manual.
TEST(Manual, NamesEverySubcommand) {
  const std::string help = runProgram({WAYMARK_PROGRAM, "--help"}).out;
  const std::string manual = readFile(WAYMARK_MANUAL);
  std::istringstream lines(help.substr(help.find("Subcommands:")));
  int subcommands = 0;
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line)) {
    std::istringstream words(line);
    std::string name;
    // Names are indented by two, the lines that a long text goes on in by more.
    if (!(words >> name) || !line.starts_with("  ") || line[2] == ' ') continue;
    ++subcommands;
    EXPECT_NE(manual.find("\n.B " + name + "\n"), std::string::npos) << name;
  }
  EXPECT_GT(subcommands, 10) << help;
}

}  // namespace
}  // namespace waymark::testing
