#include "tools/maps/map_align.h"

#include <cmath>
#include <string>
#include <tuple>

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::tools {
namespace {

using Eigen::Vector3d;
using slam::Transform;

// A room as it is: four markers on the floor, three upright on the wall at y = 4. The map of it is
// in the world of a camera that was held anyhow.
class AlignTest : public ::testing::Test {
 protected:
  AlignTest() {
    for (const auto& [id, x, y] :
         {std::tuple{1, 0.0, 0.0}, {2, 2.0, 0.5}, {3, 1.0, 3.0}, {4, 3.0, 2.0}}) {
      place(id, slam::testing::markerFacing({x, y, 0.0}, {x, y, 1.0}));
    }
    for (const int id : {10, 11, 12}) {
      const Vector3d centre(id - 10.0, 4.0, 1.5);
      place(id, slam::testing::markerFacing(centre, centre - Vector3d::UnitY()));
    }
    slam::Keyframe keyframe;
    keyframe.T_w_c = slam::testing::lookAt({1.0, -2.0, 1.2}, {1.0, 4.0, 1.0});
    (void)room_.addKeyframe(keyframe);
    slam::Vector6d anyhow;
    anyhow << 3.0, -1.0, 0.5, 0.4, 2.0, -0.3;
    T_map_room_ = Transform{}.retract(anyhow);
    map_ = room_;
    map_.moveWorld(T_map_room_);
  }

  void place(int id, const Transform& T_w_m) {
    room_.addMarker(id, 0.2);
    room_.place(
        id, T_w_m, {},
        slam::Matrix6d(slam::Vector6d(1e-6 * slam::Vector6d::LinSpaced(1, 6)).asDiagonal()));
  }

  [[nodiscard]] Vector3d at(int id) const { return map_.findPosed(id)->T_w_m->p; }
  [[nodiscard]] std::string errorOf(const AlignOptions& options) {
    const auto report = alignMap(&map_, options);
    return report ? "no error" : report.error().message;
  }

  slam::Map room_;
  slam::Map map_;
  Transform T_map_room_;
};

TEST_F(AlignTest, FloorOriginAndHeadingGiveTheRoom) {
  const auto report = alignMap(&map_, {.floor = {{1, 4}}, .origin = 1, .xy = 2});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->floor_markers, 4U);
  EXPECT_LT(report->floor_rms_m, 1e-9);
  // Of the room, but for the heading.
  const double turn = std::atan2(0.5, 2.0);
  const Eigen::Matrix3d R = Eigen::AngleAxisd(-turn, Vector3d::UnitZ()).toRotationMatrix();
  for (const auto& [id, marker] : room_.markers()) {
    EXPECT_LT((at(id) - R * marker.T_w_m->p).norm(), 1e-9) << id;
  }
  EXPECT_LT(
      (map_.keyframes().begin()->second.T_w_c.p - R * room_.keyframes().begin()->second.T_w_c.p)
          .norm(),
      1e-9);
  EXPECT_NEAR(at(2).y(), 0.0, 1e-9);
  EXPECT_GT(at(2).x(), 2.0);
}

// How sure the markers are goes along.
TEST_F(AlignTest, CovariancesTurnWithTheWorld) {
  ASSERT_TRUE(alignMap(&map_, {.floor = {{1, 4}}, .origin = 1, .xy = 2}));
  const Eigen::Matrix3d R =
      Eigen::AngleAxisd(-std::atan2(0.5, 2.0), Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Matrix3d expected =
      R * room_.find(10)->covariance.topLeftCorner<3, 3>() * R.transpose();
  EXPECT_LT((map_.find(10)->covariance.topLeftCorner<3, 3>() - expected).norm(), 1e-12);
}

TEST_F(AlignTest, AFloorAloneTurnsNoMoreThanItMust) {
  const auto report = alignMap(&map_, {.floor = {{1, 1}, {2, 2}}});
  ASSERT_TRUE(report) << report.error().message;
  for (const int id : {1, 2, 3, 4}) EXPECT_NEAR(at(id).z(), 0.0, 1e-9);
  EXPECT_NEAR(at(10).z(), 1.5, 1e-9);
  const Vector3d up_in_map = T_map_room_.R.col(2);
  const double least = std::acos(up_in_map.z());
  EXPECT_NEAR(slam::rotationDistance(report->T_new_old.R, Eigen::Matrix3d::Identity()), least,
              1e-9);
  EXPECT_NEAR(report->T_new_old.p.head<2>().norm(), 0.0, 1e-12) << "above where it was";
}

// By the centres, where these are far apart: a face is not known as well.
TEST_F(AlignTest, FacesThatAreALittleOffDoNotTiltTheFloor) {
  Transform tilted = *map_.find(3)->T_w_m;
  tilted.R = slam::expSo3(Vector3d(0.1, 0.05, 0.0)) * tilted.R;
  map_.place(3, tilted);
  ASSERT_TRUE(alignMap(&map_, {.floor = {{1, 4}}}));
  for (const int id : {1, 2, 3, 4}) EXPECT_NEAR(at(id).z(), 0.0, 1e-9) << id;
}

TEST_F(AlignTest, UprightMarkersSayWhatIsUp) {
  const auto report = alignMap(&map_, {.up = {{10, 12}}, .origin = 10, .xy = 12});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_LT((at(12) - Vector3d(2.0, 0.0, 0.0)).norm(), 1e-9);
  EXPECT_NEAR(at(1).z(), -1.5, 1e-9);
  EXPECT_EQ(report->upright_markers, 3U);
  EXPECT_NE(alignText(*report).find("up: 3 markers, 0.00 degrees rms"), std::string::npos);
}

// Both: the floor says where z is 0 only.
TEST_F(AlignTest, UprightMarkersOverruleTheFloorsTilt) {
  ASSERT_TRUE(alignMap(&map_, {.floor = {{1, 1}}, .up = {{10, 12}}}));
  EXPECT_NEAR(at(1).z(), 0.0, 1e-9);
  EXPECT_NEAR(at(10).z(), 1.5, 1e-9);
}

TEST_F(AlignTest, WithoutAVerticalTheXAxisGoesThroughTheOther) {
  const Vector3d before = map_.findPosed(12)->T_w_m->p - map_.findPosed(1)->T_w_m->p;
  ASSERT_TRUE(alignMap(&map_, {.origin = 1, .xy = 12}));
  EXPECT_LT(at(1).norm(), 1e-9);
  EXPECT_LT((at(12) - before.norm() * Vector3d::UnitX()).norm(), 1e-9);
}

TEST_F(AlignTest, SaysWhatIsInTheWay) {
  EXPECT_EQ(errorOf({}), "nothing to align by: give --floor, --up or --origin");
  EXPECT_EQ(errorOf({.floor = {{1, 4}}, .xy = 2}), "--xy needs --origin");
  EXPECT_EQ(errorOf({.origin = 2, .xy = 2}), "--xy and --origin are the same marker");
  EXPECT_EQ(errorOf({.floor = {{1, 4}, {9, 9}}}), "marker 9 has no place in the map");
  EXPECT_EQ(errorOf({.floor = {{20, 30}}}),
            "--floor: none of these markers has a place in the map");
  EXPECT_EQ(errorOf({.origin = 77}), "marker 77 has no place in the map");
  EXPECT_EQ(errorOf({.origin = 1, .xy = 77}), "marker 77 has no place in the map");
  EXPECT_EQ(errorOf({.floor = {{1, 4}, {10, 10}}}),
            "marker 10 does not face where the other markers of the floor do (76 degrees)");
  map_.addMarker(5, 0.2);
  Transform above = *map_.find(1)->T_w_m;
  above.p += above.R.col(2);
  map_.place(5, above);
  EXPECT_EQ(errorOf({.floor = {{1, 4}}, .origin = 1, .xy = 5}),
            "marker 5 is right above or below marker 1, which says no direction");
}

}  // namespace
}  // namespace waymark::tools
