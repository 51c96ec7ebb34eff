#include "tools/printing/board_sheet.h"

#include <cmath>
#include <string>

#include "slam/detection/codes/dictionary.h"
#include "tools/printing/marker_sheets.h"

namespace waymark::printing {
namespace {

struct Extent {
  double width_mm = 0.0;
  double height_mm = 0.0;
};

// Of the outermost black edges.
Extent extentOf(const calibration::BoardOptions& board) {
  const double gap_m = board.kind == calibration::BoardKind::kMarkers
                           ? board.square_size_m - board.marker_size_m
                           : 0.0;
  return {1000.0 * (board.columns * board.square_size_m - gap_m),
          1000.0 * (board.rows * board.square_size_m - gap_m)};
}

bool fits(const Extent& extent, const Box& area) {
  constexpr double kRounding_mm = 1e-6;
  return extent.width_mm <= area.width + kRounding_mm &&
         extent.height_mm <= area.height + kRounding_mm;
}

void addSquares(const calibration::BoardOptions& board, double left, double top, PdfPage* page) {
  const double side_mm = 1000.0 * board.square_size_m;
  for (int row = 0; row < board.rows; ++row) {
    for (int column = row % 2; column < board.columns; column += 2) {
      page->black.push_back({left + column * side_mm, top + row * side_mm, side_mm, side_mm});
    }
  }
}

}  // namespace

Result<PdfPage> boardSheet(const calibration::BoardOptions& board, const PageOptions& options) {
  const Extent extent = extentOf(board);
  PageOptions turned = options;
  if (!fits(extent, printableArea(turned))) turned.paper = turned.paper.turned();
  const Box area = printableArea(turned);
  if (!fits(extent, area)) {
    const Box upright = printableArea(options);
    return Error{"the board is " + millimetres(extent.width_mm) + "x" +
                 millimetres(extent.height_mm) + " mm, the page has room for " +
                 millimetres(std::floor(upright.width)) + "x" +
                 millimetres(std::floor(upright.height))};
  }
  PdfPage page = emptyPage(turned);
  const double left = area.left + 0.5 * (area.width - extent.width_mm);
  const double top = area.top;
  const bool chessboard = board.kind == calibration::BoardKind::kChessboard;
  if (chessboard || board.kind == calibration::BoardKind::kCharuco)
    addSquares(board, left, top, &page);
  if (chessboard) {
    addFooter(turned, calibration::describeBoard(board), &page);
    return page;
  }
  const slam::Dictionary dictionary = *slam::Dictionary::byName(board.dictionary);
  const calibration::Board layout(board);
  const auto& first = layout.markers().front().corners.front();
  const bool charuco = layout.isCharuco();
  // The board's frame has its origin in the centre of the grid, y up.
  const double origin_x = charuco ? left + 0.5 * extent.width_mm : left - 1000.0 * first.x();
  const double origin_y = charuco ? top + 0.5 * extent.height_mm : top + 1000.0 * first.y();
  for (const calibration::BoardMarker& marker : layout.markers()) {
    drawMarker(dictionary, marker.id, origin_x + 1000.0 * marker.corners[0].x(),
               origin_y - 1000.0 * marker.corners[0].y(), 1000.0 * board.marker_size_m,
               &page.black);
  }
  addFooter(turned, calibration::describeBoard(board), &page);
  return page;
}

}  // namespace waymark::printing
