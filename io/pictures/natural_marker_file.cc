#include "io/pictures/natural_marker_file.h"

#include <set>

#include "base/coded_image.h"
#include "io/text/json_node.h"
#include "io/text/number_text.h"
#include "io/text/plausible.h"

namespace waymark::io {
namespace {

constexpr const char* kFormat = "natural-markers";
constexpr int kVersion = 1;

double readSize(const JsonNode& node) {
  const double size_m = node.positive();
  if (node.good() && !isSize(size_m)) node.fail(kSizes);
  return size_m;
}

NaturalMarkerEntry readEntry(const JsonNode& node) {
  NaturalMarkerEntry entry;
  entry.name = node.at("name").text();
  entry.image = node.at("image").text();
  entry.width_m = readSize(node.at("width"));
  if (node.has("height")) entry.height_m = readSize(node.at("height"));
  if (node.has("T_w_m")) entry.T_w_m = node.at("T_w_m").transform();
  return entry;
}

Json entryJson(const NaturalMarkerEntry& entry) {
  Json json = {{"name", entry.name}, {"image", entry.image.string()}, {"width", entry.width_m}};
  if (entry.height_m > 0.0) json["height"] = entry.height_m;
  if (entry.T_w_m) json["T_w_m"] = toJson(*entry.T_w_m);
  return json;
}

// The entries of a file that has been parsed.
Result<std::vector<NaturalMarkerEntry>> readEntries(const Json& json,
                                                    const std::filesystem::path& file) {
  std::string fault;
  const JsonNode root(json, &fault);
  const std::string format = root.at("format").text();
  if (root.good() && format != kFormat) {
    root.at("format").fail("is '" + oneLine(format) + "', not '" + kFormat + "'");
  }
  (void)root.at("version").integer(kVersion, kVersion);
  std::vector<NaturalMarkerEntry> entries;
  std::set<std::string> names;
  if (fault.empty()) {
    for (const JsonNode& node : root.at("markers").elements()) {
      entries.push_back(readEntry(node));
      if (fault.empty() && !names.insert(entries.back().name).second) {
        node.at("name").fail("'" + oneLine(entries.back().name) + "' is there twice");
      }
      if (!fault.empty()) break;
    }
  }
  if (!fault.empty()) return Error{file.string() + ": " + fault};
  return entries;
}

}  // namespace

Result<std::vector<NaturalMarkerEntry>> parseNaturalMarkers(const std::string& text,
                                                            const std::filesystem::path& file) {
  if (isJpeg(text) || isPng(text)) {
    return Error{file.string() +
                 ": is an image; a file of natural markers is made by `waymark natural add`"};
  }
  const Result<Json> json = parseJson(text, file.string());
  if (!json) return json.error();
  return readEntries(*json, file);
}

Result<std::string> withNaturalMarker(const std::string& text, const std::filesystem::path& file,
                                      const NaturalMarkerEntry& entry) {
  Json root = {{"format", kFormat}, {"version", kVersion}, {"markers", Json::array()}};
  if (!text.empty()) {
    Result<Json> json = parseJson(text, file.string());
    if (!json) return json.error();
    const auto entries = readEntries(*json, file);
    if (!entries) return entries.error();
    for (const NaturalMarkerEntry& known : *entries) {
      if (known.name == entry.name) {
        return Error{file.string() + ": has a marker '" + entry.name + "' already"};
      }
    }
    root = std::move(*json);
  }
  root["markers"].push_back(entryJson(entry));
  return root.dump(1) + "\n";
}

}  // namespace waymark::io
