#include "tools/maps/live_map.h"

#include <limits>

#include <gtest/gtest.h>

namespace waymark::tools {
namespace {

marker_t markerAt(int id, double x) {
  marker_t marker{};
  marker.id = id;
  marker.size = 0.2;
  marker.p_w_m[0] = x;
  marker.q_w_m[0] = 1.0;
  return marker;
}

map_t pieceOf(std::int64_t revision, std::int32_t piece, std::int32_t pieces,
              std::vector<marker_t> markers) {
  map_t map{};
  map.revision = revision;
  map.piece = piece;
  map.piece_count = pieces;
  map.count = static_cast<std::int32_t>(markers.size());
  map.markers = std::move(markers);
  return map;
}

TEST(LiveMap, IsCompleteWithItsLastPieceWhateverTheOrder) {
  LiveMap map;
  EXPECT_TRUE(map.add(pieceOf(1, 1, 2, {markerAt(9, 1.0)})));
  EXPECT_TRUE(map.markers().empty());
  EXPECT_TRUE(map.add(pieceOf(1, 0, 2, {markerAt(30, 5.0), markerAt(4, 3.0)})));
  ASSERT_EQ(map.markers().size(), 3U);
  EXPECT_EQ(map.markers()[0].id, 4);
  EXPECT_EQ(map.markers()[1].id, 9);
  EXPECT_EQ(map.markers()[2].id, 30);
  // Top-left of an upright print: left of the centre and above it.
  EXPECT_TRUE(map.markers()[0].corners[0].isApprox(Eigen::Vector3d(2.9, 0.1, 0.0)));
}

TEST(LiveMap, HoldsAWorldForEachPieceOfTheMap) {
  LiveMap map;
  marker_t other = markerAt(7, 2.0);
  other.map_piece = 3;
  EXPECT_TRUE(map.add(pieceOf(1, 0, 1, {markerAt(9, 1.0), other})));
  EXPECT_EQ(map.worlds(), (std::vector<int>{0, 3}));
  ASSERT_EQ(map.markers().size(), 1U);
  EXPECT_EQ(map.markers()[0].id, 9);
  ASSERT_EQ(map.markers(3).size(), 1U);
  EXPECT_EQ(map.markers(3)[0].id, 7);
  EXPECT_TRUE(map.markers(1).empty());
}

natural_map_t naturalPart(std::int32_t piece, std::int32_t pieces, const char* name,
                          int map_piece) {
  natural_map_t map{};
  map.revision = 1;
  map.piece = piece;
  map.piece_count = pieces;
  map.count = 1;
  map.markers.resize(1);
  natural_marker_t& marker = map.markers.front();
  marker.name = name;
  marker.width = 0.6;
  marker.height = 0.4;
  marker.q_w_m[0] = 1.0;
  marker.map_piece = map_piece;
  return map;
}

TEST(LiveMap, HoldsNaturalMarkersToo) {
  LiveMap map;
  EXPECT_TRUE(map.add(pieceOf(1, 0, 1, {markerAt(9, 1.0)})));
  EXPECT_TRUE(map.add(naturalPart(0, 2, "poster", 0)));
  EXPECT_TRUE(map.natural(0).empty()) << "not all of them have come";
  EXPECT_TRUE(map.add(naturalPart(1, 2, "door", 5)));
  ASSERT_EQ(map.natural(0).size(), 1U);
  EXPECT_EQ(map.natural(0)[0].name, "poster");
  EXPECT_TRUE(map.natural(0)[0].corners[0].isApprox(Eigen::Vector3d(-0.3, 0.2, 0.0)));
  EXPECT_EQ(map.worlds(), (std::vector<int>{0, 5}));
  natural_map_t endless = naturalPart(0, 1, "endless", 0);
  endless.markers[0].width = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(map.add(endless));
  EXPECT_FALSE(map.add(naturalPart(2, 2, "none", 0)));
}

TEST(LiveMap, AnIncompleteRevisionLeavesTheOneBefore) {
  LiveMap map;
  EXPECT_TRUE(map.add(pieceOf(1, 0, 1, {markerAt(1, 0.0)})));
  EXPECT_TRUE(map.add(pieceOf(2, 0, 2, {markerAt(2, 0.0)})));
  EXPECT_TRUE(map.add(pieceOf(3, 1, 2, {markerAt(3, 0.0)})));  // the other half of 2 was lost
  ASSERT_EQ(map.markers().size(), 1U);
  EXPECT_EQ(map.markers()[0].id, 1);
}

// It counts its revisions from the beginning.
TEST(LiveMap, ADaemonThatStartsAnewHasAnotherMap) {
  LiveMap map;
  EXPECT_TRUE(map.add(pieceOf(1, 0, 1, {markerAt(9, 1.0)})));
  map_t anew = pieceOf(1, 0, 1, {markerAt(4, 1.0)});
  anew.utime = 5'000'000;
  EXPECT_TRUE(map.add(anew));
  ASSERT_EQ(map.markers().size(), 1U);
  EXPECT_EQ(map.markers()[0].id, 4);
}

TEST(LiveMap, RejectsImpossibleNumbers) {
  LiveMap map;
  marker_t no_rotation = markerAt(1, 0.0);
  no_rotation.q_w_m[0] = 0.0;
  marker_t nowhere = markerAt(1, std::numeric_limits<double>::quiet_NaN());
  marker_t no_size = markerAt(1, 0.0);
  no_size.size = -0.2;
  for (const marker_t& marker : {no_rotation, nowhere, no_size}) {
    EXPECT_FALSE(map.add(pieceOf(1, 0, 1, {marker})));
  }
  EXPECT_FALSE(map.add(pieceOf(1, 2, 2, {})));
  EXPECT_FALSE(map.add(pieceOf(1, -1, 2, {})));
  EXPECT_TRUE(map.markers().empty());
}

}  // namespace
}  // namespace waymark::tools
