// What every fuzz target shares: LLVM's entry point, and properties that must hold for any input.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "base/result.h"

// Defined by each target; called with one input after the other. Must not keep anything between
// calls.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace waymark::fuzz {

[[nodiscard]] inline std::string textOf(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

// A finding, where it does not hold.
inline void require(bool holds, const std::string& what) {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %s\n", what.c_str());
  std::abort();
}

// Errors end up in logs and on terminals: one line, whatever the input was.
inline void requireOneLine(const Error& error) {
  const auto controls = [](unsigned char c) { return c < ' ' || c == 127; };
  require(!error.message.empty(), "an error says something");
  require(std::none_of(error.message.begin(), error.message.end(), controls),
          "an error is one line: " + error.message);
}

}  // namespace waymark::fuzz
