#include "tools/usage_fault.h"

#include <vector>

#include "io/text/closest_word.h"

namespace waymark::tools {
namespace {

// The innermost command that was given.
const CLI::App& givenCommand(const CLI::App& app) {
  const std::vector<CLI::App*> given = app.get_subcommands();
  return given.empty() ? app : givenCommand(*given.front());
}

std::string unknownOption(const CLI::App& command, const std::string& word) {
  std::vector<std::string> known;
  for (const CLI::Option* option : command.get_options()) {
    for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
  }
  const std::string name = word.substr(0, word.find('='));
  const std::string meant = io::didYouMean(name, known);
  return "'" + name + "' is no option of " + command.get_name() +
         (meant.empty() ? "; --help lists them" : meant);
}

std::string unknownCommand(const CLI::App& command, const std::string& word) {
  std::vector<std::string> known;
  std::string list;
  for (const CLI::App* other : command.get_subcommands([](const CLI::App*) { return true; })) {
    known.push_back(other->get_name());
    list += (list.empty() ? "" : ", ") + other->get_name();
  }
  return "'" + word + "' is no command of " + command.get_name() + io::didYouMean(word, known) +
         (io::closestWord(word, known) ? " There are " : "; there are ") + list;
}

}  // namespace

std::string usageFault(const CLI::App& app, const std::string& said) {
  const CLI::App& command = givenCommand(app);
  for (const std::string& word : command.remaining()) {
    const bool is_option = word.size() > 2 && word.starts_with("--");
    if (is_option) return unknownOption(command, word);
    if (!word.starts_with('-') && command.get_require_subcommand_min() > 0) {
      return unknownCommand(command, word);
    }
  }
  return said;
}

}  // namespace waymark::tools
