#include "slam/natural/filter/patch.h"

#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

constexpr int kWidth = 120;
constexpr int kHeight = 100;

// A smooth picture, moved and with another gain, offset and noise.
class Picture {
 public:
  Picture(double dx, double dy, double gain, double offset, double noise, unsigned seed) {
    std::mt19937 rng(seed);
    std::normal_distribution<double> n(0.0, noise);
    pixels_.resize(kWidth * kHeight);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const double u = x - dx;
        const double v = y - dy;
        const double grey = 120.0 + 30.0 * std::sin(0.55 * u + 0.1 * v) +
                            30.0 * std::cos(0.5 * v - 0.15 * u) + 15.0 * std::sin(0.3 * (u + v));
        const double value = gain * grey + offset + (noise > 0.0 ? n(rng) : 0.0);
        pixels_[static_cast<std::size_t>(y * kWidth + x)] =
            static_cast<std::uint8_t>(std::clamp(std::lround(value), 0L, 255L));
      }
    }
    half_.resize(kWidth / 2 * (kHeight / 2));
    for (int y = 0; y < kHeight / 2; ++y) {
      for (int x = 0; x < kWidth / 2; ++x) {
        const int at = 2 * y * kWidth + 2 * x;
        const auto p = [&](int i) { return pixels_[static_cast<std::size_t>(at + i)]; };
        half_[static_cast<std::size_t>(y * kWidth / 2 + x)] =
            static_cast<std::uint8_t>((p(0) + p(1) + p(kWidth) + p(kWidth + 1) + 2) / 4);
      }
    }
  }
  [[nodiscard]] ImageView view() const { return {pixels_.data(), kWidth, kHeight, kWidth}; }
  [[nodiscard]] ImageView half() const {
    return {half_.data(), kWidth / 2, kHeight / 2, kWidth / 2};
  }

 private:
  std::vector<std::uint8_t> pixels_, half_;
};

PatchTemplate templateOf(const Picture& picture, int x, int y, int level) {
  PatchSource source;
  cutPatch(picture.view(), picture.half(), x, y, &source);
  PatchTemplate patch;
  EXPECT_TRUE(warpPatch(source, {}, level, &patch));
  return patch;
}

TEST(Patch, IsFoundWithinItsCovariance) {
  PatchOptions options;
  options.image_noise = 2.0;
  double nees = 0.0;
  double mean_error = 0.0;
  Eigen::Vector2d bias = Eigen::Vector2d::Zero();
  int count = 0;
  for (unsigned seed = 0; seed < 300; ++seed) {
    std::mt19937 rng(seed);
    std::uniform_real_distribution<double> u(-1.2, 1.2);
    const Eigen::Vector2d shift(u(rng), u(rng));
    const Picture before(0.0, 0.0, 1.0, 0.0, 2.0, seed + 1000);
    const Picture after(shift.x(), shift.y(), 1.2, -10.0, 2.0, seed + 2000);
    const PatchTemplate patch = templateOf(before, 60, 50, 0);
    const auto match = alignPatch(after.view(), patch, {60.0, 50.0}, options);
    ASSERT_TRUE(match) << seed;
    const Eigen::Vector2d error = match->at - (Eigen::Vector2d(60.0, 50.0) + shift);
    nees += error.dot(match->covariance.llt().solve(error));
    mean_error += error.norm();
    bias += error;
    ++count;
  }
  EXPECT_LT(mean_error / count, 0.08);
  EXPECT_LT((bias / count).norm(), 0.01);
  EXPECT_LT(nees / count, 2.0 * 1.5);
  EXPECT_GT(nees / count, 2.0 / 2.0);
}

TEST(Patch, IsFoundAtHalfTheSize) {
  const Picture before(0.0, 0.0, 1.0, 0.0, 0.0, 1);
  const Picture after(1.5, -1.0, 1.0, 0.0, 0.0, 2);
  const PatchTemplate patch = templateOf(before, 60, 50, 1);
  const auto match = alignPatch(after.half(), patch, {29.75, 24.75}, {});
  ASSERT_TRUE(match);
  EXPECT_LT((match->at - Eigen::Vector2d(30.5, 24.25)).norm(), 0.1);
}

// The picture turned and seen at another size, as a warp says.
TEST(Patch, IsWarped) {
  const Picture before(0.0, 0.0, 1.0, 0.0, 0.0, 1);
  Eigen::Matrix2d A;
  A << 0.9, -0.25, 0.3, 1.05;  // anchor from now
  PatchSource source;
  cutPatch(before.view(), before.half(), 60, 50, &source);
  PatchTemplate patch;
  ASSERT_TRUE(warpPatch(source, {.anchor_from_now = A}, 0, &patch));
  for (int y = 0; y < kPatchSide; ++y) {
    for (int x = 0; x < kPatchSide; ++x) {
      const Eigen::Vector2d at = A * Eigen::Vector2d(x - 3.5, y - 3.5);
      const double u = 60.0 + at.x();
      const double v = 50.0 + at.y();
      const double grey = 120.0 + 30.0 * std::sin(0.55 * u + 0.1 * v) +
                          30.0 * std::cos(0.5 * v - 0.15 * u) + 15.0 * std::sin(0.3 * (u + v));
      EXPECT_NEAR(patch.value[static_cast<std::size_t>(y * kPatchSide + x)] + patch.mean, grey,
                  4.0);
    }
  }
}

TEST(Patch, IsSearchedFor) {
  const Picture before(0.0, 0.0, 1.0, 0.0, 1.0, 1);
  const Picture after(5.0, -3.0, 0.9, 12.0, 1.0, 2);
  const PatchTemplate patch = templateOf(before, 60, 50, 0);
  const Eigen::Matrix2d information = Eigen::Matrix2d::Identity() / 49.0;
  const auto found = searchPatch(after.view(), patch, {60.0, 50.0}, information, 7, {});
  ASSERT_TRUE(found);
  EXPECT_LT((*found - Eigen::Vector2d(65.0, 47.0)).norm(), 1.0);
  // Not beyond the ellipse.
  const auto near =
      searchPatch(after.view(), patch, {60.0, 50.0}, Eigen::Matrix2d::Identity() / 4.0, 2, {});
  if (near) {
    EXPECT_LT((*near - Eigen::Vector2d(60.0, 50.0)).norm(), 3.0);
  }
}

TEST(Patch, WithoutTextureThereIsNone) {
  const std::vector<std::uint8_t> grey(kWidth * kHeight, 90);
  const ImageView image{grey.data(), kWidth, kHeight, kWidth};
  const ImageView half{grey.data(), kWidth / 2, kHeight / 2, kWidth / 2};
  PatchSource source;
  cutPatch(image, half, 60, 50, &source);
  PatchTemplate patch;
  EXPECT_FALSE(warpPatch(source, {}, 0, &patch));
}

TEST(Patch, AnotherPlaceIsNoMatch) {
  const Picture before(0.0, 0.0, 1.0, 0.0, 0.0, 1);
  const PatchTemplate patch = templateOf(before, 60, 50, 0);
  std::mt19937 rng(4);
  std::uniform_int_distribution<int> any(0, 255);
  std::vector<std::uint8_t> noise(kWidth * kHeight);
  for (std::uint8_t& v : noise) v = static_cast<std::uint8_t>(any(rng));
  EXPECT_FALSE(
      alignPatch({noise.data(), kWidth, kHeight, kWidth}, patch, {60.0, 50.0}, PatchOptions{}));
  // At the border there is no room for it.
  EXPECT_FALSE(alignPatch(before.view(), patch, {2.0, 50.0}, PatchOptions{}));
  EXPECT_FALSE(alignPatch(before.view(), patch, {60.0, kHeight - 2.0}, PatchOptions{}));
}

}  // namespace
}  // namespace waymark::slam
