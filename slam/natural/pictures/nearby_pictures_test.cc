#include "slam/natural/pictures/nearby_pictures.h"

#include <limits>
#include <numeric>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

// A metre apart along x.
std::vector<std::optional<Transform>> inARow(int count) {
  std::vector<std::optional<Transform>> places(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    places[static_cast<std::size_t>(i)] = Transform{};
    places[static_cast<std::size_t>(i)]->p.x() = i;
  }
  return places;
}

TEST(NearbyPictures, AreTheNearest) {
  const auto places = inARow(100);
  Transform T_w_c;
  T_w_c.p = {50.1, 0.0, 1.0};
  const std::vector<int> nearby =
      nearbyPictures(places, T_w_c, 1e-6 * Eigen::Matrix3d::Identity(), {.most = 5});
  EXPECT_EQ(nearby, (std::vector<int>{48, 49, 50, 51, 52}));
}

TEST(NearbyPictures, AreMoreWhereThePlaceIsUncertain) {
  const auto places = inARow(100);
  Transform T_w_c;
  T_w_c.p = {50.1, 0.0, 0.0};
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  covariance(0, 0) = 1.0;
  const std::vector<int> nearby = nearbyPictures(places, T_w_c, covariance, {.most = 5});
  EXPECT_EQ(nearby.front(), 42);  // 2.1 m for the five, and 6 m
  EXPECT_EQ(nearby.back(), 58);
  EXPECT_TRUE(nearbyPictures(places, T_w_c, 1e6 * covariance, {.most = 5}).empty());
  covariance(0, 0) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(nearbyPictures(places, T_w_c, covariance, {.most = 5}).empty());
}

TEST(NearbyPictures, AreAllWhereNothingIsKnown) {
  auto places = inARow(30);
  EXPECT_TRUE(nearbyPictures(places, std::nullopt, Eigen::Matrix3d::Zero()).empty());
  EXPECT_TRUE(nearbyPictures(inARow(7), Transform{}, Eigen::Matrix3d::Zero()).empty());
  places[29].reset();
  const auto nearby = nearbyPictures(places, Transform{}, Eigen::Matrix3d::Zero());
  EXPECT_EQ(nearby.size(), 21U);  // it may be anywhere
  EXPECT_EQ(nearby.back(), 29);
}

}  // namespace
}  // namespace waymark::slam
