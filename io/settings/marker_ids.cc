#include "io/settings/marker_ids.h"

#include <optional>
#include <string>

#include "io/text/number_text.h"

namespace waymark::io {
namespace {

Result<slam::IdRange> parseRange(std::string_view text) {
  const std::size_t dash = text.find('-');
  const std::optional<int> first = parseInteger(trim(text.substr(0, dash)));
  const std::optional<int> last =
      dash == text.npos ? first : parseInteger(trim(text.substr(dash + 1)));
  if (!first || !last || *first < 0 || *last < 0) {
    return Error{"'" + std::string(text) + "' must be an id or a range of ids like 7-9"};
  }
  if (*first > *last) return Error{"the range '" + std::string(text) + "' is empty"};
  return slam::IdRange{*first, *last};
}

}  // namespace

Result<std::vector<slam::IdRange>> parseIdRanges(std::string_view text) {
  std::vector<slam::IdRange> ranges;
  for (const std::string_view part : split(text, ',')) {
    const Result<slam::IdRange> range = parseRange(part);
    if (!range) return range.error();
    ranges.push_back(*range);
  }
  return ranges;
}

Result<std::vector<slam::MarkerOptions::Size>> parseMarkerSizes(std::string_view text) {
  std::vector<slam::MarkerOptions::Size> sizes;
  for (const std::string_view part : split(text, ',')) {
    const std::size_t equals = part.find('=');
    const auto size_m =
        equals == part.npos ? std::nullopt : parseDouble(trim(part.substr(equals + 1)));
    if (!size_m || !(*size_m > 0.0)) {
      return Error{"'" + std::string(part) + "' must be ids and a size in metres like 10-19=0.2"};
    }
    const Result<slam::IdRange> ids = parseRange(trim(part.substr(0, equals)));
    if (!ids) return ids.error();
    sizes.push_back({*ids, *size_m});
  }
  return sizes;
}

}  // namespace waymark::io
