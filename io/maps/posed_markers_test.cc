#include "io/maps/posed_markers.h"

#include <string>

#include <gtest/gtest.h>

#include "io/maps/testing_markers.h"

namespace waymark::io {
namespace {

TEST(PosedMarkers, ToAMapAndBack) {
  const PosedMarkers markers = someMarkers();
  const auto map = mapOf(markers, "f");
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_TRUE(map->keyframes().empty());
  EXPECT_FALSE(map->empty());
  EXPECT_EQ(map->find(10)->state, slam::MarkerState::kMapped);
  EXPECT_EQ(posedMarkers(*map).dictionary, markers.dictionary);
  expectSameMarkers(markers, posedMarkers(*map));
}

TEST(PosedMarkers, ThatAreNoMap) {
  const auto errorOf = [](const PosedMarkers& markers) {
    const auto map = mapOf(markers, "f.yml");
    return map ? "no error" : map.error().message;
  };
  PosedMarkers markers = someMarkers();
  markers.markers[1].size_m = 0.0;
  EXPECT_EQ(errorOf(markers), "f.yml: marker 10: has no size; give one with --size");
  markers = someMarkers();
  markers.markers[1].id = 20;
  EXPECT_EQ(errorOf(markers), "f.yml: marker 20: occurs twice");
  markers.markers[1].id = 600;
  EXPECT_EQ(errorOf(markers), "f.yml: marker 600: is not in APRILTAG_36h11, which ends with 586");
  markers = someMarkers();
  markers.markers[1].size_m = 1e4;
  EXPECT_EQ(errorOf(markers), "f.yml: marker 10: its size must be from 0.0001 to 1000 m");
  markers.markers.clear();
  EXPECT_EQ(errorOf(markers), "f.yml: has no markers");
}

TEST(PosedMarkers, CornersThatAreNoSquare) {
  const std::array<Eigen::Vector3d, 4> point = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero(),
                                                Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  EXPECT_FALSE(markerAtCorners(1, point));
  std::array<Eigen::Vector3d, 4> square = slam::markerCorners(1.0);
  EXPECT_TRUE(markerAtCorners(1, square));
  square[2].x() += 0.1;
  EXPECT_FALSE(markerAtCorners(1, square));
  std::swap(square[0], square[1]);
  EXPECT_FALSE(markerAtCorners(1, square));
}

}  // namespace
}  // namespace waymark::io
