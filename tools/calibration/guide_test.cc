#include "tools/calibration/guide.h"

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::calibration {
namespace {

// A board that somebody moves about in front of a camera, without pictures of it.
class GuideTest : public ::testing::Test {
 protected:
  // Of the board, its middle at x, y, z metres; turned about the image's axes, radians.
  [[nodiscard]] BoardView see(const Eigen::Vector3d& middle, double about_x = 0.0,
                              double about_y = 0.0) const {
    // Upright, facing the camera: the board's y points up.
    const Eigen::Matrix3d facing = Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
    const slam::Transform T_c_b{(Eigen::AngleAxisd(about_x, Eigen::Vector3d::UnitX()) *
                                 Eigen::AngleAxisd(about_y, Eigen::Vector3d::UnitY()))
                                        .toRotationMatrix() *
                                    facing,
                                middle};
    BoardView view;
    view.blur_px = 0.6;
    for (std::size_t i = 0; i < board_.points().size(); ++i) {
      const auto pixel = camera_.project(T_c_b * board_.points()[i]);
      const bool inside = pixel && pixel->x() > 0.0 && pixel->y() > 0.0 &&
                          pixel->x() < camera_.width() - 1.0 && pixel->y() < camera_.height() - 1.0;
      if (inside) view.points.push_back({i, *pixel, 0.01 * Eigen::Matrix2d::Identity()});
    }
    return view;
  }
  void show(const BoardView& view) {
    ASSERT_GE(view.points.size(), 12U);
    guide_.add(&view);
    collector_.offer("frame", view,
                     {pixels_.data(), camera_.width(), camera_.height(), camera_.width()});
  }
  [[nodiscard]] std::string advice() const { return guide_.advice(collector_).text; }

  BoardOptions options_;
  Board board_{options_};
  slam::CameraModel camera_{slam::testing::testCalibration()};
  std::vector<std::uint8_t> pixels_ =
      std::vector<std::uint8_t>(static_cast<std::size_t>(camera_.width() * camera_.height()), 128);
  ViewCollector collector_{board_, camera_.width(), camera_.height()};
  Guide guide_{board_, camera_.width(), camera_.height()};
};

TEST_F(GuideTest, MissesTheBoardAfterAWhile) {
  EXPECT_TRUE(advice().starts_with("Show the board")) << advice();
  show(see({0.0, 0.0, 0.6}));
  for (int i = 0; i < 9; ++i) guide_.add(nullptr);
  EXPECT_FALSE(advice().starts_with("Show the board"))
      << "it may be back in a moment: " << advice();
  guide_.add(nullptr);
  EXPECT_TRUE(advice().starts_with("Show the board")) << advice();
}

TEST_F(GuideTest, SaysWhereTheBoardHasNotBeen) {
  show(see({-0.12, 0.0, 0.6}));
  const std::string left = advice();
  EXPECT_TRUE(left.starts_with("Bring it there in the image: ")) << left;
  EXPECT_NE(left.find("right"), std::string::npos) << left;
  show(see({0.12, 0.0, 0.6}));
  EXPECT_NE(advice(), left);
}

TEST_F(GuideTest, AViewThatIsBlurredIsNotHeldStill) {
  for (int i = 0; i < 5; ++i) show(see({-0.1 + 0.05 * i, 0.0, 0.6}));
  BoardView moved = see({0.0, 0.1, 0.6});
  moved.blur_px = 2.0;
  show(moved);
  EXPECT_TRUE(advice().starts_with("Hold it still")) << advice();
}

// Everywhere, tilted to three sides: the fourth is asked for, and then it is enough.
TEST_F(GuideTest, AsksForTheTiltThatIsMissingUntilThereIsEnough) {
  for (int row = -1; row <= 1; ++row) {
    for (int column = -1; column <= 1; ++column) {
      for (const double away_m : {0.5, 0.6}) show(see({0.14 * column, 0.1 * row, away_m}));
    }
  }
  EXPECT_EQ(advice(), "Tilt it, so that this side of it is farther away: left, right, top, bottom");
  // About the image's y, which points down: the right side comes nearer.
  show(see({0.0, 0.0, 0.6}, 0.0, 0.5));
  EXPECT_EQ(advice(), "Tilt it, so that this side of it is farther away: right, top, bottom");
  show(see({0.0, 0.0, 0.6}, 0.0, -0.5));
  EXPECT_EQ(advice(), "Tilt it, so that this side of it is farther away: top, bottom");
  // About x: what is below goes away.
  show(see({0.0, 0.0, 0.6}, 0.5, 0.0));
  EXPECT_EQ(advice(), "Tilt it, so that this side of it is farther away: top");
  EXPECT_FALSE(guide_.advice(collector_).enough);
  show(see({0.0, 0.0, 0.6}, -0.5, 0.0));
  EXPECT_TRUE(guide_.advice(collector_).enough) << advice();
}

}  // namespace
}  // namespace waymark::calibration
