// A marker's print painted into a grey picture, with sharp edges.
#pragma once

#include "slam/detection/codes/dictionary.h"
#include "slam/testing/picture.h"

namespace waymark::slam::testing {

// left, top: the first pixel of the border. quarters: turns of the print, clockwise.
inline void drawMarker(const Dictionary& dictionary, int id, int left, int top, int cell_px,
                       int quarters, Picture* picture) {
  const int cells = dictionary.cells();
  for (int y = 0; y < cells * cell_px; ++y) {
    for (int x = 0; x < cells * cell_px; ++x) {
      int row = y / cell_px;
      int column = x / cell_px;
      for (int turn = 0; turn < quarters; ++turn) {
        const int before = row;
        row = cells - 1 - column;
        column = before;
      }
      picture->at(left + x, top + y) = dictionary.white(id, row, column) ? 200 : 30;
    }
  }
}

}  // namespace waymark::slam::testing
