#include "tools/calibration/board.h"

#include <gtest/gtest.h>
#include <opencv2/aruco/charuco.hpp>

#include "tools/calibration/board_detector.h"
#include "tools/calibration/testing/drawn_board.h"

namespace waymark::calibration {
namespace {

constexpr int kSquare_px = 60;

BoardOptions smallBoard(int columns, int rows) {
  BoardOptions options;
  options.columns = columns;
  options.rows = rows;
  return options;
}

// OpenCV's picture of the board, with a white margin of one square.
cv::Mat drawnByOpenCv(const BoardOptions& options) {
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_5X5_100);
  const auto board = cv::aruco::CharucoBoard::create(
      options.columns, options.rows, static_cast<float>(options.square_size_m),
      static_cast<float>(options.marker_size_m), dictionary);
  cv::Mat picture;
  board->draw({(options.columns + 2) * kSquare_px, (options.rows + 2) * kSquare_px}, picture,
              kSquare_px, 1);
  return picture;
}

TEST(Board, CharucoIsLaidOutAsOpenCvDrawsIt) {
  for (const auto& [columns, rows] : {std::pair{7, 10}, {6, 5}, {5, 5}, {4, 6}}) {
    const BoardOptions options = smallBoard(columns, rows);
    ASSERT_EQ(options.invalidReason(), "");
    const Board board(options);
    const cv::Mat picture = drawnByOpenCv(options);
    BoardDetector detector(board, roughCalibration(picture.cols, picture.rows));
    const auto board_view = detector.detect(testing::viewOf(picture));
    ASSERT_TRUE(board_view) << columns << "x" << rows;
    ASSERT_EQ(board_view->points.size(), static_cast<std::size_t>((columns - 1) * (rows - 1)));
    for (const BoardPoint& point : board_view->points) {
      const auto index = static_cast<int>(point.index);
      // Pixels count from centres: the corner of four pixels lies between them.
      const int row = index / (columns - 1);
      const Eigen::Vector2d expected((index % (columns - 1) + 2) * kSquare_px - 0.5,
                                     (row + 2) * kSquare_px - 0.5);
      EXPECT_LT((point.pixel - expected).norm(), 0.02) << index;
    }
  }
}

TEST(Board, TheFrameIsThatOfAMarker) {
  const Board board(smallBoard(7, 10));
  EXPECT_EQ(board.markers().size(), 35U);
  // The first corner is up and left of the centre.
  EXPECT_LT((board.points().front() - Eigen::Vector3d(-0.0625, 0.1, 0.0)).norm(), 1e-12);
  EXPECT_LT((board.points().back() - Eigen::Vector3d(0.0625, -0.1, 0.0)).norm(), 1e-12);
  const auto& marker = board.markers().front();
  EXPECT_EQ(marker.id, 0);
  EXPECT_LT(marker.corners[0].x(), marker.corners[1].x());
  EXPECT_GT(marker.corners[0].y(), marker.corners[3].y());
}

TEST(Board, MarkersRowByRow) {
  BoardOptions options = smallBoard(3, 2);
  options.kind = BoardKind::kMarkers;
  options.first_id = 7;
  const Board board(options);
  ASSERT_EQ(board.markers().size(), 6U);
  EXPECT_EQ(board.points().size(), 24U);
  EXPECT_EQ(board.markers()[4].id, 11);
  EXPECT_LT((board.points()[4 * 4 + 1] - Eigen::Vector3d(0.009, -0.0035, 0.0)).norm(), 1e-12);
}

TEST(Board, WhatCannotBe) {
  const auto reason = [](auto change) {
    BoardOptions options;
    change(options);
    return options.invalidReason();
  };
  EXPECT_EQ(reason([](BoardOptions&) {}), "");
  EXPECT_NE(reason([](BoardOptions& o) { o.columns = 2; }).find("columns"), std::string::npos);
  EXPECT_NE(reason([](BoardOptions& o) { o.rows = 1000; }).find("rows"), std::string::npos);
  EXPECT_NE(reason([](BoardOptions& o) { o.marker_size_m = 0.03; }).find("smaller than"),
            std::string::npos);
  EXPECT_NE(reason([](BoardOptions& o) {
              o.dictionary = "5X5_50";
              o.first_id = 20;
            }).find("5X5_50 has ids 0 to 49, the board needs 35 from 20 on"),
            std::string::npos);
}

TEST(Board, ALayoutIsTurnedIntoItsPlane) {
  const Board grid(smallBoard(7, 10));
  const slam::Transform T{slam::expSo3({0.3, -1.0, 0.4}), {1.0, 2.0, -3.0}};
  std::vector<BoardMarker> markers = grid.markers();
  for (BoardMarker& marker : markers) {
    for (Eigen::Vector3d& corner : marker.corners) corner = T * corner;
  }
  const auto board = Board::fromLayout("5X5_100", markers);
  ASSERT_TRUE(board) << board.error().message;
  ASSERT_EQ(board->points().size(), 4 * markers.size());
  for (std::size_t i = 0; i < board->points().size(); ++i) {
    EXPECT_NEAR(board->points()[i].z(), 0.0, 1e-9);
    const double from_first = (board->points()[i] - board->points()[0]).norm();
    EXPECT_NEAR(from_first, (markers[i / 4].corners[i % 4] - markers[0].corners[0]).norm(), 1e-9);
  }
  markers[3].corners[2].z() += 0.05;
  EXPECT_FALSE(Board::fromLayout("5X5_100", markers));
  EXPECT_FALSE(Board::fromLayout("5X5_100", {markers.front()}));
}

}  // namespace
}  // namespace waymark::calibration
