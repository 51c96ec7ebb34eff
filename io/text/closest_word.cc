#include "io/text/closest_word.h"

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <numeric>
#include <vector>

namespace waymark::io {
namespace {

bool sameLetter(char a, char b) {
  return std::tolower(static_cast<unsigned char>(a)) == std::tolower(static_cast<unsigned char>(b));
}

}  // namespace

// Three rows of the usual table: of the letters before, those before these, and now.
int editDistance(std::string_view a, std::string_view b) {
  std::vector<int> earlier(b.size() + 1);
  std::vector<int> before(b.size() + 1);
  std::vector<int> now(b.size() + 1);
  std::iota(before.begin(), before.end(), 0);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    now[0] = static_cast<int>(i);
    for (std::size_t k = 1; k <= b.size(); ++k) {
      const int replaced = before[k - 1] + (sameLetter(a[i - 1], b[k - 1]) ? 0 : 1);
      now[k] = std::min({before[k] + 1, now[k - 1] + 1, replaced});
      if (i > 1 && k > 1 && sameLetter(a[i - 1], b[k - 2]) && sameLetter(a[i - 2], b[k - 1])) {
        now[k] = std::min(now[k], earlier[k - 2] + 1);
      }
    }
    earlier.swap(before);
    before.swap(now);
  }
  return before[b.size()];
}

std::optional<std::string> closestWord(std::string_view word, std::span<const std::string> known) {
  // Long words of a command line are no names, and the table grows with both.
  constexpr std::size_t kLongest = 100;
  if (word.empty() || word.size() > kLongest) return std::nullopt;
  std::optional<std::string> nearest;
  int least = std::min(static_cast<int>(word.size()) / 4, 3) + 1;
  for (const std::string& other : known) {
    const int distance = editDistance(word, other);
    if (distance >= least) continue;
    least = distance;
    nearest = other;
  }
  return nearest;
}

std::string didYouMean(std::string_view word, std::span<const std::string> known) {
  const std::optional<std::string> nearest = closestWord(word, known);
  return nearest ? "; did you mean " + *nearest + "?" : std::string();
}

}  // namespace waymark::io
