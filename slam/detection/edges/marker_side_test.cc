#include "slam/detection/edges/marker_side.h"

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

// A marker seen obliquely through a lens: print coordinates, border and distortion must agree with
// the projection itself.
TEST(MarkerSide, AgreesWithTheProjection) {
  constexpr double kSize = 0.2;
  constexpr int kCells = 8;
  const CameraModel camera(testing::testCalibration());
  const Transform T_w_m = testing::markerFacing({0.3, 2.0, 0.2}, {1.2, 0.0, 0.4});
  const Transform T_c_w = testing::lookAt({0.0, 0.0, 0.0}, {0.0, 2.0, 0.0}).inverse();
  const auto normalized = [&](double x, double y) {
    const Eigen::Vector3d p = T_c_w * (T_w_m * Eigen::Vector3d(x, y, 0.0));
    return Eigen::Vector2d(p.x() / p.z(), p.y() / p.z());
  };
  std::array<Eigen::Vector2d, 4> corners;
  const auto print = markerCorners(kSize);
  for (std::size_t k = 0; k < 4; ++k) corners[k] = normalized(print[k].x(), print[k].y());
  const auto sides = layOutSides(camera, corners, kCells);
  ASSERT_TRUE(sides);

  const double cell = kSize / kCells;
  for (int u = 0; u <= kCells; ++u) {  // along the top side
    const Eigen::Vector2d on_edge = normalized(-0.5 * kSize + u * cell, 0.5 * kSize);
    const MarkerSide& top = (*sides)[0];
    const double t = (on_edge - top.start).dot(top.along) / top.length;
    EXPECT_NEAR(top.printCoordinate(t), u, 1e-6);
    EXPECT_NEAR((on_edge - top.start).dot(top.outward), 0.0, 1e-9);
    // The inner line of the border at the same t.
    const Eigen::Vector2d inner = normalized(-0.5 * kSize + u * cell, 0.5 * kSize - cell);
    const double t_inner = (inner - top.start).dot(top.along) / top.length;
    const double scale = top.scale_start + t_inner * (top.scale_end - top.scale_start);
    const double expected_px = -(inner - top.start).dot(top.outward) * scale;
    const double thickness_px =
        top.thickness_start + t_inner * (top.thickness_end - top.thickness_start);
    EXPECT_NEAR(thickness_px, expected_px, 0.05);
  }
  for (const MarkerSide& side : *sides) {
    for (int i = 0; i <= 10; ++i) {
      const double t = 0.1 * i;
      const Eigen::Vector2d pixel = camera.distort(side.start + t * (side.end - side.start));
      EXPECT_LT((side.pixelAt(t) - pixel).norm(), 1e-4);
    }
  }
}

TEST(MarkerSide, IsPlacedInAReducedImageAndBent) {
  const CameraModel camera(testing::testCalibration());
  const std::array<Eigen::Vector2d, 4> corners = {
      Eigen::Vector2d(0.0, 0.0), Eigen::Vector2d(0.2, 0.02), Eigen::Vector2d(0.21, 0.2),
      Eigen::Vector2d(0.01, 0.19)};
  const auto sides = layOutSides(camera, corners, 8);
  ASSERT_TRUE(sides);
  const MarkerSide& side = (*sides)[0];
  const Eigen::Vector2d origin(31.5, 21.5);
  MarkerSide placed = side;
  placed.placeIn({{}, origin, 4});
  EXPECT_NEAR(placed.length_px, 0.25 * side.length_px, 1e-9);
  EXPECT_NEAR(placed.thickness_end, 0.25 * side.thickness_end, 1e-9);
  EXPECT_NEAR(placed.scale_start, 0.25 * side.scale_start, 1e-9);
  MarkerSide bent = placed;
  bent.bend(2.0);
  for (const double t : {0.0, 0.3, 0.5, 1.0}) {
    EXPECT_LT((placed.pixelAt(t) - 0.25 * (side.pixelAt(t) - origin)).norm(), 1e-9);
    const Eigen::Vector2d moved = bent.pixelAt(t) - placed.pixelAt(t);
    EXPECT_NEAR(moved.norm(), 8.0 * t * (1.0 - t), 1e-9);
    EXPECT_LE(moved.y(), 0.0) << "outwards of the upper side";
  }
}

TEST(MarkerSide, HasNoSidesWithoutAQuad) {
  const CameraModel camera(testing::testCalibration());
  std::array<Eigen::Vector2d, 4> point;
  point.fill({0.1, 0.1});
  EXPECT_FALSE(layOutSides(camera, point, 8));
}

}  // namespace
}  // namespace waymark::slam
