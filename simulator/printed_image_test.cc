// Pictures on paper: looked up at any size, and rendered where they hang.
#include "simulator/printed_image.h"

#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "simulator/poster.h"
#include "simulator/renderer.h"
#include "simulator/testing/bare_scene.h"

namespace waymark::simulator {
namespace {

TEST(PrintedImage, LevelsShowTheSame) {
  const PosterImage poster = makePoster(PosterStyle::kPhoto, 3, 320, 240);
  const PrintedImage print(poster.view());
  EXPECT_EQ(print.levelFor(0.5F), 0);
  EXPECT_EQ(print.levelFor(4.1F), 2);
  // The mean over a block of 16 pixels is about what the fifth level has there.
  for (int k = 1; k < 9; ++k) {
    float sum = 0.0F;
    for (int i = 0; i < 256; ++i) {
      sum += print.at(0, 16.0F * static_cast<float>(k) + static_cast<float>(i % 16) + 0.5F,
                      112.0F + static_cast<float>(i / 16) + 0.5F);
    }
    const float there = print.at(4, 16.0F * static_cast<float>(k) + 8.0F, 120.0F);
    EXPECT_NEAR(there, sum / 256.0F, 0.01F);
  }
}

TEST(Poster, SeedsMakePosters) {
  const PosterImage a = makePoster(5);
  EXPECT_EQ(a.grey, makePoster(5).grey);
  EXPECT_NE(a.grey, makePoster(6).grey);
  EXPECT_EQ(a.width, 600);
  EXPECT_EQ(a.grey.size(), 480'000U);
}

// A bright square in a dark picture: its centre of brightness is where the truth projects it.
TEST(Renderer, PrintsHangWhereTheyAre) {
  std::vector<std::uint8_t> grey(200 * 100, 0);
  for (int y = 60; y < 80; ++y) {
    for (int x = 120; x < 140; ++x) grey[static_cast<std::size_t>(200 * y + x)] = 255;
  }
  Scene scene = testing::bareScene("print");
  scene.camera.distortion = {-0.2, 0.05, 0.0005, -0.0007};
  Print print{std::make_shared<PrintedImage>(ImageView{grey.data(), 200, 100, 200}, 0.0, 255.0),
              0.4, 0.2, slam::Transform{}};
  print.T_w_p.R << 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0;
  print.T_w_p.R = slam::expSo3({0.1, -0.3, 0.2}) * print.T_w_p.R;
  print.T_w_p.p = {0.02, 0.01, 0.6};
  scene.prints.push_back(print);
  const auto renderer = Renderer::create(scene, 1, 2);
  ASSERT_TRUE(renderer);
  Renderer::Workspace workspace;
  renderer->render({{slam::Transform{}}}, {}, &workspace);

  const slam::CameraModel camera(scene.camera);
  const auto truth = camera.project(print.T_w_p * Eigen::Vector3d(0.06, -0.04, 0.0));
  ASSERT_TRUE(truth);
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double weight = 0.0;
  for (int y = -14; y <= 14; ++y) {
    for (int x = -14; x <= 14; ++x) {
      const int column = static_cast<int>(std::lround(truth->x())) + x;
      const int row = static_cast<int>(std::lround(truth->y())) + y;
      const double light = workspace.radiance.row(row + 2)[column + 2];
      sum += light * Eigen::Vector2d(column, row);
      weight += light;
    }
  }
  // Perspective moves a square's middle of brightness a little.
  EXPECT_GT(weight, 10'000.0);
  EXPECT_LT((sum / weight - *truth).norm(), 0.15);

  // From behind there is nothing.
  slam::Transform behind;
  behind.R << -1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0;
  behind.p = {0.0, 0.0, 1.2};
  renderer->render({{behind}}, {}, &workspace);
  for (const float light : workspace.radiance.pixels) EXPECT_EQ(light, 90.0F);
}

// A sheet before a dark wall, turned a little in the image: how far its edge reaches into each row
// is what the truth says, not a whole number of pixels.
TEST(Renderer, OutlinesAreNoStairs) {
  const std::vector<std::uint8_t> white(4, 255);
  const auto image = [&white](double light) {
    return std::make_shared<PrintedImage>(ImageView{white.data(), 2, 2, 2}, 0.0, light);
  };
  Scene scene = testing::bareScene("outline");
  Surface wall{.half_width_m = 3.0, .half_height_m = 3.0, .image = image(40.0)};
  wall.T_w_s.p = {0.0, 0.0, 2.0};
  Surface sheet{.half_width_m = 0.2, .half_height_m = 0.2, .image = image(240.0)};
  sheet.T_w_s.p = {0.0, 0.0, 1.0};
  sheet.T_w_s.R = slam::expSo3({0.0, 0.2, 0.1});
  scene.surfaces = {wall, sheet};
  constexpr int kMargin = 2;
  const auto renderer = Renderer::create(scene, 1, kMargin);
  ASSERT_TRUE(renderer);
  Renderer::Workspace workspace;
  renderer->render({{slam::Transform{}}}, {}, &workspace);

  const slam::CameraModel camera(scene.camera);
  const auto top = camera.project(sheet.T_w_s * Eigen::Vector3d(0.2, -0.15, 0.0));
  const auto bottom = camera.project(sheet.T_w_s * Eigen::Vector3d(0.2, 0.15, 0.0));
  ASSERT_TRUE(top && bottom);
  ASSERT_GT(bottom->y() - top->y(), 50.0);
  for (int row = static_cast<int>(top->y()) + 1; row < static_cast<int>(bottom->y()); ++row) {
    double bright = 0.0;  // columns, from the image's middle on
    const float* const pixels = workspace.radiance.row(row + kMargin) + kMargin;
    for (int column = 160; column < 320; ++column) bright += (pixels[column] - 40.0) / 200.0;
    const double share = (row - top->y()) / (bottom->y() - top->y());
    const double edge = top->x() + share * (bottom->x() - top->x());
    EXPECT_NEAR(bright, edge - 159.5, 0.07) << row;
  }
}

}  // namespace
}  // namespace waymark::simulator
