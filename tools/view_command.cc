#include "tools/view_command.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include <CLI/CLI.hpp>
#include <unistd.h>

#include "base/program_directory.h"
#include "tools/exit_code.h"

namespace waymark::tools {
namespace {

namespace fs = std::filesystem;

// Beside this program, as installed; where it is built; else wherever the shell would find it. In a
// build directory it is told where the page's files are.
std::vector<std::string> programAndPlaces() {
  std::error_code error;
  const fs::path here = programDirectory();
  if (fs::exists(here / "waymark-view", error)) return {(here / "waymark-view").string()};
  const fs::path built = here.parent_path() / "view" / "waymark-view";
  if (!fs::exists(built, error)) return {"waymark-view"};
  // build/PRESET/tools of the tree.
  const fs::path tree = here.parent_path().parent_path().parent_path();
  return {built.string(), "--page", (tree / "view/page").string(), "--health",
          (tree / "docs/health.md").string()};
}

ExitCode view(const std::vector<std::string>& arguments) {
  std::vector<std::string> command = programAndPlaces();
  command.insert(command.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& word : command) argv.push_back(word.data());
  argv.push_back(nullptr);
  ::execvp(argv[0], argv.data());
  std::fprintf(stderr, "waymark view: waymark-view cannot be run: %s%s\n", std::strerror(errno),
               errno == ENOENT ? "; it is in the package waymark-view" : "");
  return kBadInput;
}

}  // namespace

void addViewCommand(CLI::App& app, int* exit_code) {
  CLI::App* const command = app.add_subcommand(
      "view", "Show in a browser what a daemon publishes, results of run, or a recording");
  command->footer(
      "[SOURCE] is a directory of results or an event log of waymarkd; without one the running "
      "daemon "
      "is shown. These and all options, which must come after it, are waymark-view's: waymark-view "
      "--help tells.");
  command->prefix_command();
  command->callback([command, exit_code] { *exit_code = view(command->remaining()); });
}

}  // namespace waymark::tools
