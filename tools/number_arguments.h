// Numbers on the command line. CLI11's own checks let NaN and 1e300 pass.
#pragma once

#include <optional>
#include <string>

#include <CLI/CLI.hpp>

#include "io/text/number_text.h"

namespace waymark::tools {

// For CLI::Option::check: a number from `least` to `most`.
inline CLI::Validator numberFrom(double least, double most) {
  return {[least, most](const std::string& text) {
            const std::optional<double> value = io::parseDouble(text);
            if (value && *value >= least && *value <= most) return std::string();
            return "'" + text + "' must be a number from " + io::roundTrip(least) + " to " +
                   io::roundTrip(most);
          },
          "NUMBER"};
}

// Hz. Frames of a slower source than one in a quarter of an hour are photographs.
inline CLI::Validator frameRate() { return numberFrom(1e-3, 1e4); }

// Seconds that a command lasts, thirty years at most.
inline CLI::Validator duration() { return numberFrom(1e-3, 1e9); }

}  // namespace waymark::tools
