// Files of natural markers, and the cache of features beside them.
#include "io/pictures/feature_cache.h"
#include "io/pictures/natural_marker_file.h"
#include "tests/fuzz/fuzz_target.h"

using namespace waymark;

namespace {

// What is read can be added to, and read again.
void markers(const std::string& text) {
  const auto entries = io::parseNaturalMarkers(text, "n.json");
  if (!entries) return fuzz::requireOneLine(entries.error());
  const auto more = io::withNaturalMarker(text, "n.json", {"one more", "x.png", 0.3, 0.2, {}});
  if (!more) return fuzz::requireOneLine(more.error());  // its name was there
  const auto again = io::parseNaturalMarkers(*more, "n.json");
  fuzz::require(again.ok(), "what was added to is read: " +
                                (again ? std::string() : again.error().message) + "\n" + *more);
  fuzz::require(again->size() == entries->size() + 1, "there is one more\n" + *more);
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text = fuzz::textOf(data, size);
  markers(text);
  const io::FeatureCache cache = io::parseFeatureCache(text);
  const io::FeatureCache again = io::parseFeatureCache(io::formatFeatureCache(cache));
  fuzz::require(again.features.size() == cache.features.size(),
                "a cache is read as it was written");
  return 0;
}
