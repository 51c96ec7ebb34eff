// Numbers as text and back, independent of the locale.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace waymark::io {

// The shortest text that reads back as the same double. Precondition: finite.
[[nodiscard]] std::string roundTrip(double value);
// With a fixed number of decimals; never "-0.000".
[[nodiscard]] std::string fixed(double value, int decimals);

// The whole text must be a finite number.
[[nodiscard]] std::optional<double> parseDouble(std::string_view text);
[[nodiscard]] std::optional<int> parseInteger(std::string_view text);

// Trimmed fields. With a blank as separator, runs of blanks and tabs count as one.
[[nodiscard]] std::vector<std::string_view> split(std::string_view line, char separator);
// Without blanks, tabs and carriage returns at both ends.
[[nodiscard]] std::string_view trim(std::string_view text);
// For messages, which quote what files say: newlines and other control characters become blanks.
[[nodiscard]] std::string oneLine(std::string_view text);

}  // namespace waymark::io
