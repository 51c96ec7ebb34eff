#include "io/pictures/natural_marker_set.h"

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/coded_image.h"
#include "io/pictures/feature_cache.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "slam/natural/pictures/picture_points.h"

namespace waymark::io {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostImageBytes = std::size_t{256} << 20U;
constexpr std::size_t kMostCacheBytes = std::size_t{2} << 30U;

// An image file and the picture in it.
struct ImageFile {
  std::string bytes;
  cv::Mat grey;

  [[nodiscard]] ImageView view() const {
    return {grey.data, grey.cols, grey.rows, static_cast<std::ptrdiff_t>(grey.step)};
  }
};

Result<ImageFile> readImage(const fs::path& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) return Error{path.string() + ": is a directory"};
  if (fs::is_fifo(path, error)) return Error{path.string() + ": is no file"};
  Result<std::string> bytes = readTextFile(path, kMostImageBytes);
  if (!bytes) return bytes.error();
  ImageFile file;
  file.bytes = std::move(*bytes);
  if (file.bytes.empty()) return Error{path.string() + ": is empty"};
  if (const char* fault = imageFault(file.bytes)) return Error{path.string() + ": " + fault};
  const cv::Mat coded(1, static_cast<int>(file.bytes.size()), CV_8U, file.bytes.data());
  try {
    file.grey = cv::imdecode(coded, cv::IMREAD_GRAYSCALE);
  } catch (const cv::Exception&) {
    file.grey.release();
  }
  if (file.grey.empty()) return Error{path.string() + ": is no image that can be read"};
  return file;
}

// Empty where not much of a picture was left out.
std::string reducedNote(const ImageFile& image, const slam::NaturalMarker& marker) {
  const auto& kept = marker.grey().level(0);
  if (kept.width >= image.grey.cols / 4) return {};
  return "has " + sizeText(image.grey.cols, image.grey.rows) + " pixels, of which " +
         sizeText(kept.width, kept.height) + " are used";
}

FeatureCache readCache(const fs::path& markers) {
  const Result<std::string> bytes = readTextFile(featureCachePath(markers), kMostCacheBytes);
  return bytes ? parseFeatureCache(*bytes) : FeatureCache{};
}

std::vector<AlikeKeys> keysOf(const std::vector<slam::AlikePictures>& pairs,
                              const std::vector<std::uint64_t>& keys) {
  std::vector<AlikeKeys> alike;
  for (const slam::AlikePictures& pair : pairs) {
    alike.push_back({keys[static_cast<std::size_t>(pair.first)],
                     keys[static_cast<std::size_t>(pair.second)], pair.shared, pair.share});
  }
  return alike;
}

// By their places, as findAlike() has them. Precondition: the cache is of these pictures.
std::vector<slam::AlikePictures> alikeIn(const FeatureCache& cache,
                                         const std::vector<std::uint64_t>& keys) {
  const auto placeOf = [&keys](std::uint64_t key) {
    return static_cast<int>(std::ranges::find(keys, key) - keys.begin());
  };
  std::vector<slam::AlikePictures> pairs;
  for (const AlikeKeys& pair : cache.alike) {
    const auto [first, second] = std::minmax({placeOf(pair.first), placeOf(pair.second)});
    pairs.push_back({first, second, pair.shared, pair.share});
  }
  std::ranges::sort(pairs, {}, [](const auto& pair) { return std::pair(pair.first, pair.second); });
  return pairs;
}

}  // namespace

Result<NaturalPicture> readNaturalMarker(const fs::path& image, double width_m, double height_m,
                                         const slam::NaturalMarkerOptions& options) {
  const Result<ImageFile> file = readImage(image);
  if (!file) return file.error();
  auto marker = slam::NaturalMarker::create(file->view(), width_m, height_m, options);
  if (!marker) return Error{image.string() + ": " + marker.error().message};
  std::string note = reducedNote(*file, *marker);
  if (!note.empty()) note = image.string() + ": " + note;
  return NaturalPicture{std::move(*marker), featureKey(file->bytes, options), std::move(note)};
}

Result<NaturalMarkerSet> readNaturalMarkers(const fs::path& file,
                                            const slam::NaturalMarkerOptions& options) {
  const Result<std::string> text = readTextFile(file);
  if (!text) return text.error();
  auto entries = parseNaturalMarkers(*text, file);
  if (!entries) return entries.error();
  if (entries->empty()) return Error{file.string() + ": has no markers"};
  return readNaturalMarkers(std::move(*entries), file, options);
}

Result<NaturalMarkerSet> readNaturalMarkers(std::vector<NaturalMarkerEntry> entries,
                                            const fs::path& file,
                                            const slam::NaturalMarkerOptions& options) {
  NaturalMarkerSet set;
  set.entries = std::move(entries);
  const FeatureCache cache = readCache(file);
  FeatureCache next;
  std::map<std::uint64_t, std::string> names;  // of the pictures so far, by their key
  for (const NaturalMarkerEntry& entry : set.entries) {
    const std::string place = file.string() + ": marker '" + oneLine(entry.name) + "': ";
    const fs::path path = file.parent_path() / entry.image;
    const std::string picture = oneLine(path.string());
    const Result<ImageFile> image = readImage(path);
    if (!image) return Error{place + oneLine(image.error().message)};
    const std::uint64_t key = featureKey(image->bytes, options);
    if (const auto [known, added] = names.try_emplace(key, entry.name); !added) {
      return Error{place + picture + ": is the same picture as that of '" + oneLine(known->second) +
                   "'"};
    }
    const auto cached = cache.features.find(key);
    auto marker =
        slam::NaturalMarker::create(image->view(), entry.width_m, entry.height_m, options,
                                    cached != cache.features.end() ? &cached->second : nullptr);
    if (!marker) return Error{place + picture + ": " + marker.error().message};
    if (cached == cache.features.end()) ++set.computed;
    next.features[key] = marker->features();
    const std::string note = reducedNote(*image, *marker);
    if (!note.empty()) set.notes.push_back(place + picture + ": " + note);
    set.markers.push_back(std::move(*marker));
    set.keys.push_back(key);
  }
  if (set.computed == 0 && next.features.size() == cache.features.size()) {
    set.alike = alikeIn(cache, set.keys);
    return set;
  }
  set.alike = slam::findAlike(set.markers);
  next.alike = keysOf(set.alike, set.keys);
  // A folder that cannot be written to only costs time.
  (void)writeTextFile(featureCachePath(file), formatFeatureCache(next));
  return set;
}

std::string alikeNote(const NaturalMarkerSet& set, const fs::path& file) {
  const std::vector<slam::AlikePictures>& pairs = set.alike;
  if (pairs.empty()) return {};
  const auto nameOf = [&](int place) {
    return "'" + oneLine(set.entries[static_cast<std::size_t>(place)].name) + "'";
  };
  const slam::AlikePictures& first = pairs.front();
  std::string note = file.string() + ": " + nameOf(first.first) + " and " + nameOf(first.second) +
                     " look alike (" + fixed(100.0 * first.share, 0) + " % of the features)";
  if (pairs.size() > 1) {
    note += ", and " + std::to_string(pairs.size() - 1) + " other " +
            (pairs.size() > 2 ? "pairs" : "pair");
  }
  return note + ": where an image does not tell which it is, neither is used";
}

std::vector<slam::PicturePrint> printsOf(const NaturalMarkerSet& set) {
  std::vector<slam::PicturePrint> prints;
  for (std::size_t i = 0; i < set.entries.size(); ++i) {
    const NaturalMarkerEntry& entry = set.entries[i];
    const slam::NaturalMarker& marker = set.markers[i];
    prints.push_back({.name = entry.name,
                      .width_m = marker.width_m(),
                      .height_m = marker.height_m(),
                      .T_w_m = entry.T_w_m,
                      .points_m = slam::picturePoints(marker)});
  }
  return prints;
}

std::vector<slam::PosedNaturalMarker> picturesOf(NaturalMarkerSet set) {
  std::vector<slam::PosedNaturalMarker> pictures;
  for (std::size_t i = 0; i < set.entries.size(); ++i) {
    pictures.push_back(
        {slam::pictureId(set.entries[i].name), std::move(set.markers[i]), set.entries[i].T_w_m});
  }
  return pictures;
}

}  // namespace waymark::io
