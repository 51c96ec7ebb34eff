// What a benchmark reads from its command line, and ends with.
#pragma once

#include <cstdio>
#include <optional>

#include <CLI/CLI.hpp>

#include "base/result.h"
#include "io/text/number_text.h"
#include "tools/exit_code.h"

namespace waymark::bench {

// The exit code when there is nothing to run: after --help, or after one line on what is wrong.
[[nodiscard]] inline std::optional<int> parse(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);  // --help
    std::fprintf(stderr, "%s: %s\n", app.get_name().c_str(), io::oneLine(e.what()).c_str());
    return tools::kBadInput;
  }
  return std::nullopt;
}

// At the end: one line on what went wrong, if anything did.
[[nodiscard]] inline tools::ExitCode exitCodeOf(const char* program, const Status& done) {
  if (!done) std::fprintf(stderr, "%s: %s\n", program, done.error().message.c_str());
  return done ? tools::kDone : tools::kBadInput;
}

}  // namespace waymark::bench
