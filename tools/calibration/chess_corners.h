// The corners of a plain chessboard, which has nothing that says which is which: only whole boards
// are found. Turned by half a turn a board may look the same; calibration does not mind.
#pragma once

#include <vector>

#include "base/image_view.h"
#include "tools/calibration/board_detector.h"

namespace waymark::calibration {

// Of a board of columns x rows squares, the inner corners row by row, each measured in the grey
// levels around it. Empty where the board is not there as a whole.
[[nodiscard]] BoardView findChessCorners(const ImageView& image, int columns, int rows,
                                         const BoardDetectorOptions& options);

}  // namespace waymark::calibration
