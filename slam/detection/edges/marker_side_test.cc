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

TEST(MarkerSide, HasNoSidesWithoutAQuad) {
  const CameraModel camera(testing::testCalibration());
  std::array<Eigen::Vector2d, 4> point;
  point.fill({0.1, 0.1});
  EXPECT_FALSE(layOutSides(camera, point, 8));
}

}  // namespace
}  // namespace waymark::slam
