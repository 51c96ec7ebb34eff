// Times in text files are decimal seconds; inside the program they are integer nanoseconds. These
// two convert without passing through a double, which would lose the last digits of a wall clock.
#pragma once

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <optional>
#include <string>
#include <string_view>

namespace waymark {

inline constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;
// No time from a file is farther from 0: 146 years from 1970, or from the start of a computer. Sums
// and differences of two still are numbers.
inline constexpr std::int64_t kFarthest_ns = (std::int64_t{1} << 62U) - 1;

// "12.000000345", always nine decimals.
[[nodiscard]] inline std::string formatSeconds(std::int64_t time_ns) {
  // Unsigned, so that the most negative time has a magnitude too.
  const std::uint64_t magnitude =
      time_ns < 0 ? 0 - static_cast<std::uint64_t>(time_ns) : static_cast<std::uint64_t>(time_ns);
  constexpr auto kSecond = static_cast<std::uint64_t>(kNanosecondsPerSecond);
  char text[32];
  std::snprintf(text, sizeof text, "%s%llu.%09llu", time_ns < 0 ? "-" : "",
                static_cast<unsigned long long>(magnitude / kSecond),
                static_cast<unsigned long long>(magnitude % kSecond));
  return text;
}

// Accepts "1560889276.31902", "-3", ".5", "1.56088927631902e+09"; rounds what is finer than a
// nanosecond. Empty for anything else, and beyond kFarthest_ns.
[[nodiscard]] inline std::optional<std::int64_t> parseSeconds(std::string_view text) {
  bool negative = false;
  if (!text.empty() && (text.front() == '-' || text.front() == '+')) {
    negative = text.front() == '-';
    text.remove_prefix(1);
  }
  int exponent = 0;
  if (const std::size_t e = text.find_first_of("eE"); e != std::string_view::npos) {
    const std::string digits(text.substr(e + 1));
    char* end = nullptr;
    const long value = std::strtol(digits.c_str(), &end, 10);
    if (digits.empty() || *end != '\0' || value < -100 || value > 100) return std::nullopt;
    exponent = static_cast<int>(value);
    text = text.substr(0, e);
  }
  std::string digits;
  std::optional<std::size_t> point;
  for (const char c : text) {
    if (c == '.' && !point) {
      point = digits.size();
    } else if (c >= '0' && c <= '9') {
      digits.push_back(c);
    } else {
      return std::nullopt;
    }
  }
  if (digits.empty()) return std::nullopt;

  // Digits in front of the point once the value is written in nanoseconds.
  const long whole = static_cast<long>(point.value_or(digits.size())) + exponent + 9;
  std::int64_t time_ns = 0;
  for (long i = 0; i < whole; ++i) {
    const int digit =
        i < static_cast<long>(digits.size()) ? digits[static_cast<std::size_t>(i)] - '0' : 0;
    if (time_ns > (kFarthest_ns - digit - 1) / 10) return std::nullopt;
    time_ns = time_ns * 10 + digit;
  }
  const bool round_up = whole >= 0 && whole < static_cast<long>(digits.size()) &&
                        digits[static_cast<std::size_t>(whole)] >= '5';
  if (round_up) ++time_ns;
  return negative ? -time_ns : time_ns;
}

}  // namespace waymark
