// Features of pictures, and which of these look alike, computed once and kept: a file beside that
// of the natural markers, in which each picture's features stand under the checksum of what they
// are made from.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "slam/natural/pictures/natural_marker.h"

namespace waymark::io {

// Two pictures by their keys, as slam::AlikePictures.
struct AlikeKeys {
  std::uint64_t first = 0;
  std::uint64_t second = 0;
  int shared = 0;
  double share = 0.0;
};

struct FeatureCache {
  // By the checksum of the image's bytes and of the options.
  std::map<std::uint64_t, slam::FeatureSet> features;
  std::vector<AlikeKeys> alike;  // of all of them
};

// FILE.json.features, beside the file of the markers.
[[nodiscard]] std::filesystem::path featureCachePath(const std::filesystem::path& markers);

// Of the bytes of an image file and the options that decide on its features (FNV-1a, 64 bits).
[[nodiscard]] std::uint64_t featureKey(std::string_view image,
                                       const slam::NaturalMarkerOptions& options);

// Nothing that was written by another version, is cut off or damaged is taken: empty then. A cache
// that is missing is no fault.
[[nodiscard]] FeatureCache parseFeatureCache(std::string_view bytes);
[[nodiscard]] std::string formatFeatureCache(const FeatureCache& cache);

}  // namespace waymark::io
