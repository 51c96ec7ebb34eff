#include "io/pictures/feature_cache.h"

#include <cmath>

#include <gtest/gtest.h>

namespace waymark::io {
namespace {

FeatureCache someCache() {
  FeatureCache cache;
  for (std::uint64_t key : {7U, 9U}) {
    slam::FeatureSet& set = cache.features[key];
    set.descriptor_bytes = 128;
    set.upright = 2;
    for (int i = 0; i < 3; ++i) {
      set.features.push_back({1.5F * static_cast<float>(i), 2.0F, 3.0F, 0.4F, 0.01F});
      set.descriptors.insert(set.descriptors.end(), 128, static_cast<std::uint8_t>(i + key));
    }
  }
  cache.alike.push_back({7, 9, 2, 0.625});
  return cache;
}

TEST(FeatureCache, ComesBackAsItWas) {
  const FeatureCache cache = someCache();
  const FeatureCache back = parseFeatureCache(formatFeatureCache(cache));
  ASSERT_EQ(back.features.size(), 2U);
  EXPECT_EQ(back.features.at(9).descriptors, cache.features.at(9).descriptors);
  EXPECT_EQ(back.features.at(9).upright, 2U);
  EXPECT_EQ(back.features.at(7).features[1].x_px, 1.5F);
  ASSERT_EQ(back.alike.size(), 1U);
  EXPECT_EQ(back.alike[0].first, 7U);
  EXPECT_EQ(back.alike[0].second, 9U);
  EXPECT_EQ(back.alike[0].shared, 2);
  EXPECT_EQ(back.alike[0].share, 0.625);
}

TEST(FeatureCache, DamagedIsEmpty) {
  const std::string whole = formatFeatureCache(someCache());
  EXPECT_TRUE(parseFeatureCache("").features.empty());
  EXPECT_TRUE(parseFeatureCache("WMFEAT02").features.empty());
  for (std::size_t i = 0; i < whole.size(); i += 41) {
    EXPECT_TRUE(parseFeatureCache(std::string_view(whole).substr(0, i)).features.empty()) << i;
    std::string damaged = whole;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x10);
    EXPECT_TRUE(parseFeatureCache(damaged).features.empty()) << i;
  }
}

TEST(FeatureCache, FeaturesWithoutDescriptorsAreNone) {
  FeatureCache cache;
  cache.features[1].features.resize(3);
  EXPECT_TRUE(parseFeatureCache(formatFeatureCache(cache)).features.empty());
}

TEST(FeatureCache, PicturesThatAreNotThereAreNotAlike) {
  for (const AlikeKeys& pair : {AlikeKeys{7, 8, 2, 0.5}, {7, 7, 2, 0.5}, {9, 7, 2, NAN}}) {
    FeatureCache cache = someCache();
    cache.alike.push_back(pair);
    EXPECT_TRUE(parseFeatureCache(formatFeatureCache(cache)).features.empty());
  }
}

TEST(FeatureCache, KeysAreOfImageAndOptions) {
  const slam::NaturalMarkerOptions options;
  slam::NaturalMarkerOptions more = options;
  more.max_features += 1;
  slam::NaturalMarkerOptions stricter = options;
  stricter.min_contrast += 1.0;  // decides on the picture, not on its features
  EXPECT_NE(featureKey("image", options), featureKey("imagf", options));
  EXPECT_NE(featureKey("image", options), featureKey("image", more));
  EXPECT_EQ(featureKey("image", options), featureKey("image", stricter));
}

}  // namespace
}  // namespace waymark::io
