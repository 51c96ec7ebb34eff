#include "slam/detection/codes/dictionary.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <random>
#include <utility>
#include <vector>

#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h11.h>
#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

TEST(Dictionary, KnowsEveryNameItLists) {
  const std::vector<std::string> names = Dictionary::names();
  EXPECT_EQ(names.size(), 21U);
  for (const std::string& name : names) {
    const auto dictionary = Dictionary::byName(name);
    ASSERT_TRUE(dictionary.has_value()) << name;
    EXPECT_GT(dictionary->size(), 0) << name;
  }
  EXPECT_FALSE(Dictionary::byName("8X8_50").has_value());
  EXPECT_FALSE(Dictionary::byName("").has_value());
}

TEST(Dictionary, FourQuarterTurnsAreNone) {
  const auto dictionary = Dictionary::byName("ARUCO_MIP_36h12");
  ASSERT_TRUE(dictionary);
  std::uint64_t code = dictionary->code(17);
  for (int i = 0; i < 4; ++i) code = Dictionary::rotateClockwise(code, 6);
  EXPECT_EQ(code, dictionary->code(17));
  // One white cell at the top left goes to the top right.
  EXPECT_EQ(Dictionary::rotateClockwise(0b1000, 2), 0b0100U);
}

TEST(Dictionary, HasTheDistanceInItsName) {
  EXPECT_EQ(Dictionary::byName("ARUCO_MIP_36h12")->minDistance(), 12);
  EXPECT_EQ(Dictionary::byName("APRILTAG_36h11")->minDistance(), 11);
  EXPECT_EQ(Dictionary::byName("APRILTAG_25h9")->minDistance(), 9);
  EXPECT_EQ(Dictionary::byName("APRILTAG_16h5")->minDistance(), 5);
}

TEST(Dictionary, IdentifiesRotatedAndDamagedCodes) {
  const auto dictionary = Dictionary::byName("ARUCO_MIP_36h12");
  ASSERT_TRUE(dictionary);
  for (int id = 0; id < dictionary->size(); id += 7) {
    std::uint64_t code = dictionary->code(id);
    for (int rotation = 0; rotation < 4; ++rotation) {
      const auto exact = dictionary->identify(code, 0);
      ASSERT_TRUE(exact);
      EXPECT_EQ(exact->id, id);
      EXPECT_EQ(exact->rotation, rotation);
      const std::uint64_t damaged = code ^ (1ULL << (id % 36)) ^ (1ULL << ((id + 11) % 36));
      EXPECT_FALSE(dictionary->identify(damaged, 1));
      const auto corrected = dictionary->identify(damaged, 2);
      ASSERT_TRUE(corrected);
      EXPECT_EQ(corrected->id, id);
      EXPECT_EQ(corrected->rotation, rotation);
      EXPECT_EQ(corrected->hamming, 2);
      code = Dictionary::rotateClockwise(code, 6);
    }
  }
}

// By the definition, code by code; some random codes are as far from two.
TEST(Dictionary, IdentifiesTheNearestOfAllCodes) {
  for (const char* const name : {"APRILTAG_36h11", "4X4_50", "ARUCO_ORIGINAL"}) {
    const auto dictionary = Dictionary::byName(name);
    ASSERT_TRUE(dictionary);
    const int bits = dictionary->side() * dictionary->side();
    std::mt19937_64 random(7);
    int ties = 0;
    for (int k = 0; k < 200; ++k) {
      const std::uint64_t code = random() >> (64 - bits);
      int least = bits;
      std::vector<std::pair<int, int>> nearest;  // id, rotation
      for (int id = 0; id < dictionary->size(); ++id) {
        std::uint64_t turned = dictionary->code(id);
        for (int rotation = 0; rotation < 4; ++rotation) {
          const int distance = std::popcount(turned ^ code);
          if (distance < least) nearest.clear();
          if (distance <= least) nearest.emplace_back(id, rotation);
          least = std::min(least, distance);
          turned = Dictionary::rotateClockwise(turned, dictionary->side());
        }
      }
      EXPECT_EQ(dictionary->distanceTo(code), least);
      EXPECT_FALSE(least > 0 && dictionary->identify(code, least - 1));
      const auto match = dictionary->identify(code, least);
      if (nearest.size() > 1 && least > 0) {
        ++ties;
        EXPECT_FALSE(match) << name;
      } else {
        ASSERT_TRUE(match) << name;
        EXPECT_EQ(std::pair(match->id, match->rotation), nearest.front()) << name;
        EXPECT_EQ(match->hamming, least);
      }
    }
    EXPECT_GT(ties, 0) << name;
  }
}

TEST(Dictionary, BorderIsBlack) {
  const auto dictionary = Dictionary::byName("4X4_50");
  ASSERT_TRUE(dictionary);
  for (int i = 0; i < dictionary->cells(); ++i) {
    EXPECT_FALSE(dictionary->white(0, 0, i));
    EXPECT_FALSE(dictionary->white(0, i, 0));
    EXPECT_FALSE(dictionary->white(0, dictionary->cells() - 1, i));
    EXPECT_FALSE(dictionary->white(0, i, dictionary->cells() - 1));
  }
}

struct AprilTagFamily {
  const char* name;
  std::function<apriltag_family_t*()> create;
  std::function<void(apriltag_family_t*)> destroy;
};

// Draws every tag with the AprilTag library and compares cell by cell.
TEST(Dictionary, AprilTagsAreUprightAsTheirLibraryDrawsThem) {
  const AprilTagFamily families[] = {
      {"APRILTAG_16h5", tag16h5_create, tag16h5_destroy},
      {"APRILTAG_25h9", tag25h9_create, tag25h9_destroy},
      {"APRILTAG_36h11", tag36h11_create, tag36h11_destroy},
  };
  for (const AprilTagFamily& entry : families) {
    const auto dictionary = Dictionary::byName(entry.name);
    ASSERT_TRUE(dictionary);
    apriltag_family_t* family = entry.create();
    ASSERT_EQ(static_cast<std::uint32_t>(dictionary->size()), family->ncodes) << entry.name;
    for (int id = 0; id < dictionary->size(); ++id) {
      image_u8_t* image = apriltag_to_image(family, static_cast<std::uint32_t>(id));
      const int quiet = (image->width - dictionary->cells()) / 2;
      int wrong = 0;
      for (int r = 0; r < dictionary->cells(); ++r) {
        for (int c = 0; c < dictionary->cells(); ++c) {
          const bool white = image->buf[(r + quiet) * image->stride + c + quiet] > 127;
          wrong += white != dictionary->white(id, r, c) ? 1 : 0;
        }
      }
      ASSERT_EQ(wrong, 0) << entry.name << " id " << id;
      std::free(image->buf);  // Debian's library does not export image_u8_destroy
      std::free(image);
    }
    entry.destroy(family);
  }
}

}  // namespace
}  // namespace waymark::slam
