// "did you mean": which of the words there are is nearest to one that is none of them.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace waymark::io {

// Letters to insert, drop, replace or exchange with the next one until the two are the same; upper
// and lower case are the same letter.
[[nodiscard]] int editDistance(std::string_view a, std::string_view b);

// The nearest word, the first one of several. Empty when none is near: more than a quarter of the
// letters would have to change, or more than three.
[[nodiscard]] std::optional<std::string> closestWord(std::string_view word,
                                                     std::span<const std::string> known);

// For the end of a message: "; did you mean WORD?". Empty when there is no such word.
[[nodiscard]] std::string didYouMean(std::string_view word, std::span<const std::string> known);

}  // namespace waymark::io
