// What is wrong with a command line, in one line for people.
#pragma once

#include <string>

#include <CLI/App.hpp>

namespace waymark::tools {

// `said`: CLI11's own words for it. A command or an option that is none is named, with the one that
// was probably meant: CLI11 only says that a command is missing, or that arguments were not
// expected.
[[nodiscard]] std::string usageFault(const CLI::App& app, const std::string& said);

}  // namespace waymark::tools
