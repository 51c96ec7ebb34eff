#include "slam/natural/filter/feature_search.h"

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "slam/natural/filter/point_view.h"
#include "slam/natural/filter/testing_textured_wall.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr int kWidth = 320;
constexpr int kHeight = 240;

// An image with its halves.
struct Levelled {
  explicit Levelled(std::vector<std::uint8_t> pixels)
      : full(std::move(pixels)),
        half(halved(full, kWidth, kHeight)),
        quarter(halved(half, kWidth / 2, kHeight / 2)) {}

  static std::vector<std::uint8_t> halved(const std::vector<std::uint8_t>& in, int width,
                                          int height) {
    std::vector<std::uint8_t> out;
    for (int y = 0; y + 1 < height; y += 2) {
      for (int x = 0; x + 1 < width; x += 2) {
        const auto at = static_cast<std::size_t>(y * width + x);
        const auto below = at + static_cast<std::size_t>(width);
        out.push_back(
            static_cast<std::uint8_t>((in[at] + in[at + 1] + in[below] + in[below + 1] + 2) / 4));
      }
    }
    return out;
  }
  [[nodiscard]] ImageLevels views() const {
    return {ImageView{full.data(), kWidth, kHeight, kWidth},
            ImageView{half.data(), kWidth / 2, kHeight / 2, kWidth / 2},
            ImageView{quarter.data(), kWidth / 4, kHeight / 4, kWidth / 4}};
  }
  std::vector<std::uint8_t> full, half, quarter;
};

// A camera that goes along a wall, which it sees at a slant: what was small and far is large and
// near, and its far side is not as large as its near one.
class SlantedWallTest : public ::testing::Test {
 protected:
  [[nodiscard]] Levelled imageFrom(const Transform& T_w_c, unsigned seed) {
    std::vector<std::uint8_t> pixels;
    wall_.render(camera_, T_w_c, 1.0, seed, &pixels);
    return Levelled(pixels);
  }
  // Of all patches that are found, pixels.
  struct Errors {
    std::vector<double> sizes;
    [[nodiscard]] double median() {
      std::ranges::sort(sizes);
      return sizes[sizes.size() / 2];
    }
  };
  [[nodiscard]] Errors errors(bool with_surface, bool with_perspective) {
    const Transform T_w_a = testing::lookAt({-2.0, -0.9, 0.0}, {0.5, 0.0, 0.0});
    Transform T_w_c = T_w_a;
    T_w_c.p.x() += 0.8;
    const Levelled before = imageFrom(T_w_a, 1);
    const Levelled now = imageFrom(T_w_c, 2);
    Errors errors;
    for (int y = 30; y < kHeight - 30; y += 6) {
      for (int x = 60; x < kWidth - 60; x += 6) {
        const auto error = errorAt(x, y, T_w_a, T_w_c, before, now, with_surface, with_perspective);
        if (!error) continue;
        errors.sizes.push_back(error->norm());
      }
    }
    return errors;
  }

 private:
  [[nodiscard]] std::optional<Eigen::Vector2d> errorAt(int x, int y, const Transform& T_w_a,
                                                       const Transform& T_w_c,
                                                       const Levelled& before, const Levelled& now,
                                                       bool with_surface, bool with_perspective) {
    const auto uv = camera_.undistort({x, y});
    const Eigen::Vector3d n_a = T_w_a.R.transpose() * Eigen::Vector3d::UnitY();
    const double d = -T_w_a.p.y();
    const double cosine = n_a.dot(uv->homogeneous());
    if (!uv || !(cosine > 0.1)) return std::nullopt;
    FeatureLook look;
    cutPatch(before.views()[0], before.views()[1], x, y, &look.source);
    PatchTemplate patch;
    if (!warpPatch(look.source, {}, 0, &patch)) return std::nullopt;
    if (!(longestSigma(patch.covariance(1.0)) < 0.05)) return std::nullopt;
    Eigen::Matrix2d D;
    (void)camera_.distort(*uv, &D);
    look.uv_from_pixel = D.inverse();
    if (with_surface) look.surface = n_a.head<2>() / cosine;
    const StateFeature feature{.uv = *uv, .rho = cosine / d};
    PointView view;
    if (!viewFeature(camera_, T_w_c, T_w_a, feature, &view)) return std::nullopt;
    ExpectedFeature expected{.pixel = view.at,
                             .covariance = 0.04 * Eigen::Matrix2d::Identity(),
                             .J_feature = view.J_feature};
    if (with_perspective) expected.J_forward = view.J_forward;
    if (!camera_.inImage(view.at, 10.0)) return std::nullopt;
    const auto found = findFeature(now.views(), look, feature.rho, expected, {}, {});
    if (!found) return std::nullopt;
    return Eigen::Vector2d(found->pixel - view.at);
  }

  CameraModel camera_{testing::wideCalibration(kWidth, kHeight)};
  testing::TexturedWall wall_{5};
};

TEST_F(SlantedWallTest, PatchesAreWarpedWithTheirSurface) {
  Errors flat = errors(false, false);
  Errors affine = errors(true, false);
  Errors whole = errors(true, true);
  for (const auto& [name, of] : {std::pair{"flat", &flat}, {"affine", &affine}, {"all", &whole}}) {
    std::printf("%s: %zu found, median %.3f px\n", name, of->sizes.size(), of->median());
  }
  EXPECT_GT(whole.sizes.size(), 50U);
  EXPECT_LT(whole.median(), 0.7 * flat.median());
  EXPECT_LT(whole.median(), affine.median());
}

// Against the plane itself, without a lens: pixels about the feature now, and where in the anchor's
// image the same points of the plane are.
TEST(FeatureSearch, TheWarpIsThePlanesHomography) {
  Calibration pinhole{.width = 640, .height = 480};
  pinhole.fx = pinhole.fy = 400.0;
  pinhole.cx = 319.5;
  pinhole.cy = 239.5;
  const CameraModel camera(pinhole);
  const Transform T_w_a = testing::lookAt({-2.0, -0.9, 0.0}, {0.5, 0.0, 0.1});
  Transform T_w_c = testing::lookAt({-1.1, -0.8, 0.1}, {0.5, 0.1, 0.0});
  const Eigen::Vector2d uv(0.1, -0.05);
  // The plane y = 0 of the world.
  const Eigen::Vector3d n_a = T_w_a.R.row(1).transpose();
  const StateFeature feature{.uv = uv, .rho = n_a.dot(uv.homogeneous()) / -T_w_a.p.y()};
  FeatureLook look;
  look.uv_from_pixel = Eigen::Matrix2d::Identity() / pinhole.fx;
  look.surface = n_a.head<2>() / n_a.dot(uv.homogeneous());
  PointView view;
  ASSERT_TRUE(viewFeature(camera, T_w_c, T_w_a, feature, &view));
  const auto warp =
      warpOf(look, feature.rho,
             {.pixel = view.at, .J_feature = view.J_feature, .J_forward = view.J_forward});
  ASSERT_TRUE(warp);
  const Eigen::Vector2d anchor_pixel = camera.distort(uv);
  double affine_px = 0.0;
  for (const double x : {-8.0, 0.0, 8.0}) {
    for (const double y : {-8.0, 0.0, 8.0}) {
      const Eigen::Vector2d u(x, y);
      const Eigen::Vector3d ray_w = T_w_c.R * camera.undistort(view.at + u).value().homogeneous();
      const Eigen::Vector3d p_w = T_w_c.p - T_w_c.p.y() / ray_w.y() * ray_w;
      const Eigen::Vector2d exact = *camera.project(T_w_a.inverse() * p_w) - anchor_pixel;
      const Eigen::Vector2d affine = warp->anchor_from_now * u;
      EXPECT_LT((affine / (1.0 - warp->bend.dot(u)) - exact).norm(), 1e-6) << x << ' ' << y;
      affine_px = std::max(affine_px, (affine - exact).norm());
    }
  }
  EXPECT_GT(affine_px, 0.05) << "it would be affine anyway";
}

TEST(FeatureSearch, LevelsMeetInTheirMiddles) {
  const Eigen::Vector2d pixel(31.0, 12.5);
  EXPECT_EQ(onLevel(pixel, 0), pixel);
  EXPECT_EQ(onLevel(pixel, 1), Eigen::Vector2d(15.25, 6.0));
  EXPECT_EQ(fromLevel(onLevel(pixel, 2), 2), pixel);
}

// What would be seen at less than a third of its size, or more than three times it, is not looked
// for.
TEST(FeatureSearch, WhatLooksOtherwiseHasNoWarp) {
  FeatureLook look;
  look.uv_from_pixel = Eigen::Matrix2d::Identity() / 300.0;
  ExpectedFeature expected;
  expected.J_feature.leftCols<2>() = 300.0 * Eigen::Matrix2d::Identity();
  ASSERT_TRUE(warpOf(look, 0.5, expected));
  expected.J_feature *= 3.5;
  EXPECT_FALSE(warpOf(look, 0.5, expected));
  expected.J_feature /= 3.5 * 3.5;
  EXPECT_FALSE(warpOf(look, 0.5, expected));
}

}  // namespace
}  // namespace waymark::slam
