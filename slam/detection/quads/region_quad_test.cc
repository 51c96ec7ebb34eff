#include "slam/detection/quads/region_quad.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>

#include <gtest/gtest.h>

#include "slam/detection/quads/dark_mask.h"
#include "slam/testing/picture.h"

namespace waymark::slam {
namespace {

// A light picture with dark shapes, as a threshold would see them.
class Shapes {
 public:
  // Dark where `inside` says so of a pixel's centre.
  template <typename Inside>
  void darken(const Inside& inside, std::uint8_t grey = 20) {
    picture_.paint(grey, [&](int x, int y) { return inside(Eigen::Vector2d(x, y)); });
  }
  void darken(const Quad& quad) {
    darken([&](const Eigen::Vector2d& p) {
      for (std::size_t k = 0; k < 4; ++k) {
        const Eigen::Vector2d side = quad[(k + 1) % 4] - quad[k];
        const Eigen::Vector2d to = p - quad[k];
        if (side.x() * to.y() - side.y() * to.x() < 0.0) return false;
      }
      return true;
    });
  }

  // Valid until the next call.
  std::span<const DarkRegion> regions() { return finder_.find(masks_.make(picture_.view())[0]); }

 private:
  testing::Picture picture_{160, 120, 200};
  DarkMaskMaker masks_{std::array{DarkMaskOptions{}}};
  DarkRegionFinder finder_;
};

// Clockwise in the image, around (80, 60).
Quad turned(double side, double angle, double squeeze = 1.0) {
  Quad quad;
  for (std::size_t k = 0; k < 4; ++k) {
    const double a = angle + 0.5 * std::numbers::pi * static_cast<double>(k);
    const double r = side / std::numbers::sqrt2;
    quad[k] = Eigen::Vector2d(80.3, 60.6) + r * Eigen::Vector2d(std::cos(a), squeeze * std::sin(a));
  }
  return quad;
}

// Farthest distance of a corner from the nearest one of the other.
double difference(const Quad& a, const Quad& b) {
  double farthest = 0.0;
  for (const auto& p : a) {
    double nearest = 1e9;
    for (const auto& q : b) nearest = std::min(nearest, (p - q).norm());
    farthest = std::max(farthest, nearest);
  }
  return farthest;
}

TEST(RegionQuad, FindsSquaresTurnedAnyWay) {
  for (const double side : {14.0, 25.0, 60.0}) {
    for (int degrees = 0; degrees < 90; degrees += 3) {
      const Quad truth = turned(side, degrees * std::numbers::pi / 180.0);
      Shapes shapes;
      shapes.darken(truth);
      const auto regions = shapes.regions();
      ASSERT_EQ(regions.size(), 1U) << side << " px, " << degrees << " degrees";
      const auto quad = RegionQuadFitter().fit(regions[0]);
      ASSERT_TRUE(quad) << side << " px, " << degrees << " degrees";
      EXPECT_LT(difference(*quad, truth), 1.2) << side << " px, " << degrees << " degrees";
      const Eigen::Vector2d a = (*quad)[1] - (*quad)[0];
      const Eigen::Vector2d b = (*quad)[2] - (*quad)[1];
      EXPECT_GT(a.x() * b.y() - a.y() * b.x(), 0.0) << "clockwise in the image";
    }
  }
}

TEST(RegionQuad, FindsSquaresSeenFromTheSide) {
  for (int degrees = 0; degrees < 90; degrees += 7) {
    const Quad truth = turned(40.0, degrees * std::numbers::pi / 180.0, 0.4);
    Shapes shapes;
    shapes.darken(truth);
    const auto quad = RegionQuadFitter().fit(shapes.regions()[0]);
    ASSERT_TRUE(quad) << degrees << " degrees";
    EXPECT_LT(difference(*quad, truth), 2.0) << degrees << " degrees";
  }
}

TEST(RegionQuad, ALightCellMayBreakThroughTheBorder) {
  const Quad truth = turned(40.0, 0.4);
  Shapes shapes;
  shapes.darken(truth);
  const Eigen::Vector2d hole = 0.5 * (truth[0] + truth[1]);
  shapes.darken([&](const Eigen::Vector2d& p) { return (p - hole).norm() < 5.0; }, 200);
  const auto quad = RegionQuadFitter().fit(shapes.regions()[0]);
  ASSERT_TRUE(quad);
  EXPECT_LT(difference(*quad, truth), 1.2);
}

TEST(RegionQuad, OtherShapesAreNone) {
  const auto quads = [](const auto& inside) {
    Shapes shapes;
    shapes.darken(inside);
    int count = 0;
    for (const DarkRegion& region : shapes.regions()) {
      count += RegionQuadFitter().fit(region) ? 1 : 0;
    }
    return count;
  };
  const Eigen::Vector2d middle(80.0, 60.0);
  EXPECT_EQ(quads([&](const auto& p) { return (p - middle).norm() < 30.0; }), 0) << "disc";
  EXPECT_EQ(
      quads([&](const auto& p) { return p.y() > 30.0 && p.y() < 90.0 - p.x() && p.x() > 10.0; }), 0)
      << "triangle";
  EXPECT_EQ(quads([&](const auto& p) {
              const bool upright = p.x() > 40.0 && p.x() < 60.0 && p.y() > 20.0 && p.y() < 100.0;
              const bool foot = p.x() >= 60.0 && p.x() < 120.0 && p.y() > 80.0 && p.y() < 100.0;
              return upright || foot;
            }),
            0)
      << "an L";
  EXPECT_EQ(quads([&](const auto& p) {
              return p.x() > 77.0 && p.x() < 82.0 && p.y() > 20.0 && p.y() < 100.0;
            }),
            0)
      << "too narrow";
}

TEST(DarkRegions, CornersThatTouchDoNotJoin) {
  Shapes shapes;
  shapes.darken([](const Eigen::Vector2d& p) {
    const bool first = p.x() >= 30 && p.x() < 60 && p.y() >= 30 && p.y() < 60;
    const bool second = p.x() >= 60 && p.x() < 90 && p.y() >= 60 && p.y() < 90;
    return first || second;
  });
  const auto regions = shapes.regions();
  ASSERT_EQ(regions.size(), 2U);
  EXPECT_EQ(regions[0].left, 30);
  EXPECT_EQ(regions[0].right, 59);
  EXPECT_EQ(regions[0].top, 30);
  EXPECT_EQ(regions[0].bottom, 59);
  EXPECT_EQ(regions[1].left, 60);
  EXPECT_EQ(regions[1].rows.size(), 30U);
}

TEST(DarkRegions, BranchesThatMeetBelowAreOne) {
  Shapes shapes;
  shapes.darken([](const Eigen::Vector2d& p) {
    const bool tooth =
        (p.x() >= 30 && p.x() < 40) || (p.x() >= 50 && p.x() < 60) || (p.x() >= 70 && p.x() < 80);
    return p.y() >= 20 && p.y() < 50 && (tooth || (p.y() >= 40 && p.x() >= 30 && p.x() < 80));
  });
  const auto regions = shapes.regions();
  ASSERT_EQ(regions.size(), 1U);
  EXPECT_EQ(regions[0].left, 30);
  EXPECT_EQ(regions[0].right, 79);
  EXPECT_EQ(regions[0].rows[0].left, 30);
  EXPECT_EQ(regions[0].rows[0].right, 79);
}

TEST(DarkRegions, WhatTheImageCutsOffIsLeftOut) {
  Shapes shapes;
  shapes.darken([](const Eigen::Vector2d& p) { return p.x() < 30.0 && p.y() > 40 && p.y() < 70; });
  shapes.darken([](const Eigen::Vector2d& p) { return p.y() > 100.0 && p.x() > 60 && p.x() < 90; });
  EXPECT_TRUE(shapes.regions().empty());
}

}  // namespace
}  // namespace waymark::slam
