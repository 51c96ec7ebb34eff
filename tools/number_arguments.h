// Numbers on the command line. CLI11's own checks let NaN and 1e300 pass, and say ranges in
// hundreds of digits.
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

// More than zero. CLI11's own says "not in range" with all 309 digits of the largest number.
inline CLI::Validator positiveNumber() {
  return {[](const std::string& text) {
            const std::optional<double> value = io::parseDouble(text);
            if (value && *value > 0.0) return std::string();
            return "'" + text + "' must be a number greater than 0";
          },
          "NUMBER"};
}

inline CLI::Validator wholeNumberFrom(int least, int most) {
  return {[least, most](const std::string& text) {
            const std::optional<int> value = io::parseInteger(text);
            if (value && *value >= least && *value <= most) return std::string();
            return "'" + text + "' must be a whole number from " + std::to_string(least) + " to " +
                   std::to_string(most);
          },
          "NUMBER"};
}

// How many of something, at least one.
inline CLI::Validator count() { return wholeNumberFrom(1, 1'000'000'000); }

// Hz. Frames of a slower source than one in a quarter of an hour are photographs.
inline CLI::Validator frameRate() { return numberFrom(1e-3, 1e4); }

// Seconds that a command lasts, thirty years at most.
inline CLI::Validator duration() { return numberFrom(1e-3, 1e9); }

}  // namespace waymark::tools
