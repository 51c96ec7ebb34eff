#include "tools/calibration/chess_corners.h"

#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace waymark::calibration {
namespace {

// A chessboard of 7 x 6 squares, seen straight on, drawn with squares of whole pixels.
cv::Mat drawn(int square_px, double angle_deg) {
  cv::Mat image(480, 640, CV_8UC1, cv::Scalar(230));
  for (int row = 0; row < 6; ++row) {
    for (int column = row % 2; column < 7; column += 2) {
      cv::rectangle(image, {120 + column * square_px, 90 + row * square_px, square_px, square_px},
                    cv::Scalar(30), cv::FILLED);
    }
  }
  if (angle_deg != 0.0) {
    const cv::Mat turn = cv::getRotationMatrix2D({319.5F, 239.5F}, angle_deg, 1.0);
    cv::warpAffine(image, image, turn, image.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  }
  cv::GaussianBlur(image, image, {0, 0}, 0.8);
  return image;
}

ImageView viewOf(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, static_cast<std::ptrdiff_t>(image.step)};
}

TEST(ChessCorners, AreWhereTheyWereDrawn) {
  const cv::Mat image = drawn(48, 0.0);
  const BoardView view = findChessCorners(viewOf(image), 7, 6, {});
  ASSERT_EQ(view.points.size(), 30U);
  EXPECT_NEAR(view.blur_px, 0.8, 0.2);
  // Whichever end comes first: the middle of the edge between two pixels is at .5 less.
  for (const BoardPoint& point : view.points) {
    const double column = (point.pixel.x() + 0.5 - 120.0) / 48.0;
    const double row = (point.pixel.y() + 0.5 - 90.0) / 48.0;
    EXPECT_NEAR(column, std::round(column), 0.03 / 48.0);
    EXPECT_NEAR(row, std::round(row), 0.03 / 48.0);
  }
  // Row by row.
  const double first = (view.points[1].pixel - view.points[0].pixel).norm();
  EXPECT_NEAR(first, 48.0, 0.1);
  EXPECT_NEAR((view.points[6].pixel - view.points[0].pixel).norm(), 48.0, 0.1);
}

TEST(ChessCorners, AreInTheOrderOfABoardSeenFromItsFront) {
  for (const double angle : {-100.0, -30.0, 15.0, 90.0, 170.0}) {
    const cv::Mat image = drawn(34, angle);
    const BoardView view = findChessCorners(viewOf(image), 7, 6, {});
    ASSERT_EQ(view.points.size(), 30U) << angle;
    const Eigen::Vector2d x = view.points[1].pixel - view.points[0].pixel;
    const Eigen::Vector2d y = view.points[6].pixel - view.points[0].pixel;
    EXPECT_GT(x.x() * y.y() - x.y() * y.x(), 0.0) << angle;
  }
}

TEST(ChessCorners, PartOfABoardIsNone) {
  cv::Mat image = drawn(48, 0.0);
  image.colRange(0, 200) = cv::Scalar(230);
  EXPECT_TRUE(findChessCorners(viewOf(image), 7, 6, {}).points.empty());
}

TEST(Chessboard, HasItsInnerCornersOnly) {
  BoardOptions options;
  options.kind = BoardKind::kChessboard;
  options.columns = 7;
  options.rows = 6;
  options.square_size_m = 0.03;
  options.dictionary.clear();
  EXPECT_EQ(options.invalidReason(), "");
  const Board board(options);
  EXPECT_TRUE(board.markers().empty());
  ASSERT_EQ(board.points().size(), 30U);
  EXPECT_NEAR((board.points()[1] - board.points()[0]).norm(), 0.03, 1e-12);
  EXPECT_EQ(describeBoard(options), "Chessboard 7x6, squares 30 mm");
  options.rows = 3;
  EXPECT_EQ(options.invalidReason(), "rows: must be 4 to 200");
}

}  // namespace
}  // namespace waymark::calibration
