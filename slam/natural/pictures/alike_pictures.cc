#include "slam/natural/pictures/alike_pictures.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "slam/natural/pictures/picture_matcher.h"

namespace waymark::slam {
namespace {

// The features of a picture as it is, without its tilted views.
FeatureSet uprightOf(const FeatureSet& set) {
  FeatureSet upright{set.kind, set.descriptor_bytes, {}, {}, set.upright};
  const auto count = static_cast<std::ptrdiff_t>(set.upright);
  upright.features.assign(set.features.begin(), set.features.begin() + count);
  upright.descriptors.assign(set.descriptors.begin(),
                             set.descriptors.begin() + count * set.descriptor_bytes);
  return upright;
}

// The picture as a camera sees it that is one width away, square on.
std::vector<ImageFeature> seenSquareOn(const NaturalMarker& marker) {
  std::vector<ImageFeature> seen;
  for (std::size_t i = 0; i < marker.features().upright; ++i) {
    const Feature& feature = marker.features().features[i];
    const Eigen::Vector2d at = marker.featurePoint(i) / marker.width_m();
    seen.push_back({{at.x(), -at.y()},
                    feature.size_px * marker.pixel_m() / marker.width_m(),
                    {std::cos(feature.angle_rad), std::sin(feature.angle_rad)}});
  }
  return seen;
}

}  // namespace

std::vector<AlikePictures> findAlike(std::span<const NaturalMarker> markers, double least_share,
                                     const DescriptorIndexOptions& options) {
  std::vector<FeatureSet> upright;
  for (const NaturalMarker& marker : markers) upright.push_back(uprightOf(marker.features()));
  std::vector<const FeatureSet*> sets;
  for (const FeatureSet& set : upright) sets.push_back(&set);
  const DescriptorIndex index(sets, options);

  PictureMatcherOptions matcher;
  matcher.neighbours = 10;  // the feature itself is one of them
  matcher.min_inliers = 8;
  matcher.most_instances = 1;
  std::map<std::pair<int, int>, AlikePictures> pairs;
  for (std::size_t i = 0; i < markers.size(); ++i) {
    auto matches = matchFeatures(upright[i], index, markers.size(), matcher);
    const std::vector<ImageFeature> seen = seenSquareOn(markers[i]);
    const double focal_px = markers[i].width_m() / markers[i].pixel_m();
    for (std::size_t k = 0; k < markers.size(); ++k) {
      if (k == i || matches[k].size() < static_cast<std::size_t>(matcher.min_inliers)) continue;
      const auto found = locatePicture(static_cast<int>(k), markers[k], seen, std::move(matches[k]),
                                       focal_px, k, matcher);
      if (found.empty()) continue;
      const std::size_t fewer = std::min(upright[i].size(), upright[k].size());
      const int shared = static_cast<int>(found.front().inliers.size());
      const double share = static_cast<double>(shared) / static_cast<double>(fewer);
      if (share < least_share) continue;
      const auto [a, b] = std::minmax({static_cast<int>(i), static_cast<int>(k)});
      AlikePictures& pair = pairs[{a, b}];
      if (shared > pair.shared) pair = {a, b, shared, share};
    }
  }
  std::vector<AlikePictures> alike;
  for (const auto& [key, pair] : pairs) alike.push_back(pair);
  return alike;
}

}  // namespace waymark::slam
