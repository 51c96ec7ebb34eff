// printf into a string, for figures.
#pragma once

#include <cstdio>
#include <string>

namespace waymark::bench {

// Up to 399 characters; what is longer is cut off.
template <typename... Values>
[[nodiscard]] std::string formatted(const char* format, Values... values) {
  char text[400];
  std::snprintf(text, sizeof(text), format, values...);
  return text;
}

}  // namespace waymark::bench
