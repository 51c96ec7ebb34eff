#include "slam/natural/pictures/descriptor_index.h"

#include <random>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

constexpr int kBytes = 128;

// Clusters, as descriptors come.
FeatureSet randomSet(std::size_t count, unsigned seed) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> value(40.0, 30.0);
  FeatureSet set{FeatureKind::kSift, kBytes, {}, {}};
  set.features.resize(count);
  for (std::size_t i = 0; i < count * kBytes; ++i) {
    set.descriptors.push_back(static_cast<std::uint8_t>(std::clamp(value(rng), 0.0, 255.0)));
  }
  return set;
}

std::vector<std::uint8_t> near(const std::uint8_t* descriptor, std::mt19937* rng) {
  std::normal_distribution<double> noise(0.0, 10.0);
  std::vector<std::uint8_t> moved(descriptor, descriptor + kBytes);
  for (std::uint8_t& b : moved) {
    b = static_cast<std::uint8_t>(std::clamp(b + noise(*rng), 0.0, 255.0));
  }
  return moved;
}

TEST(DescriptorIndex, FindsNearlyAllNearestOnes) {
  std::vector<FeatureSet> sets;
  std::vector<const FeatureSet*> pointers;
  for (unsigned i = 0; i < 20; ++i) sets.push_back(randomSet(500, i));
  for (const FeatureSet& set : sets) pointers.push_back(&set);
  const DescriptorIndex index(pointers);
  ASSERT_EQ(index.size(), 10'000U);
  DescriptorIndex::Workspace workspace;
  std::vector<DescriptorIndex::Neighbour> found;
  std::mt19937 rng(7);
  int right = 0;
  constexpr int kQueries = 300;
  for (int i = 0; i < kQueries; ++i) {
    const std::size_t picture = rng() % sets.size();
    const std::size_t feature = rng() % 500;
    const auto query = near(sets[picture].descriptor(feature), &rng);
    index.nearest(query.data(), 3, &workspace, &found);
    ASSERT_EQ(found.size(), 3U);
    EXPECT_LE(found[0].distance, found[1].distance);
    EXPECT_LE(found[1].distance, found[2].distance);
    right += found[0].picture == static_cast<int>(picture) &&
             found[0].feature == static_cast<int>(feature);
  }
  EXPECT_GE(right, kQueries * 85 / 100);
}

TEST(DescriptorIndex, ComparesAllOfAFew) {
  const FeatureSet set = randomSet(100, 1);
  const FeatureSet* const pointers[] = {nullptr, &set};
  const DescriptorIndex index(pointers);
  DescriptorIndex::Workspace workspace;
  std::vector<DescriptorIndex::Neighbour> found;
  for (std::size_t i = 0; i < set.size(); ++i) {
    index.nearest(set.descriptor(i), 2, &workspace, &found);
    EXPECT_EQ(found[0].picture, 1);
    EXPECT_EQ(found[0].feature, static_cast<int>(i));
    EXPECT_EQ(found[0].distance, 0);
    EXPECT_GT(found[1].distance, 0);
  }
}

TEST(DescriptorIndex, HoldsManyEqualDescriptors) {
  FeatureSet set{FeatureKind::kSift, kBytes, {}, {}};
  set.features.resize(5000);
  set.descriptors.assign(5000 * kBytes, 17);
  const FeatureSet* const pointers[] = {&set};
  const DescriptorIndex index(pointers);
  DescriptorIndex::Workspace workspace;
  std::vector<DescriptorIndex::Neighbour> found;
  index.nearest(set.descriptor(0), 6, &workspace, &found);
  ASSERT_EQ(found.size(), 6U);
  EXPECT_EQ(found.back().distance, 0);
}

// Features whose descriptors have no bytes cannot be split by any of them.
TEST(DescriptorIndex, LeavesOutWhatCannotBeCompared) {
  FeatureSet bare{FeatureKind::kSift, 0, {}, {}};
  bare.features.resize(5000);
  const FeatureSet* const alone[] = {&bare};
  EXPECT_EQ(DescriptorIndex(alone).size(), 0U);
  const FeatureSet set = randomSet(2000, 1);
  FeatureSet bits{FeatureKind::kOrb, 32, {}, {}};
  bits.features.resize(2000);
  bits.descriptors.resize(2000 * 32);
  const FeatureSet* const mixed[] = {&bare, &set, &bits};
  const DescriptorIndex index(mixed);
  EXPECT_EQ(index.size(), 2000U);
  DescriptorIndex::Workspace workspace;
  std::vector<DescriptorIndex::Neighbour> found;
  index.nearest(set.descriptor(3), 2, &workspace, &found);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].picture, 1);
  EXPECT_EQ(found[0].feature, 3);
}

TEST(DescriptorIndex, AnEmptyOneFindsNothing) {
  const DescriptorIndex index;
  DescriptorIndex::Workspace workspace;
  std::vector<DescriptorIndex::Neighbour> found(2);
  const std::vector<std::uint8_t> query(kBytes, 0);
  index.nearest(query.data(), 3, &workspace, &found);
  EXPECT_TRUE(found.empty());
}

}  // namespace
}  // namespace waymark::slam
