// Pages of markers, true to scale.
#pragma once

#include <string>
#include <vector>

#include "base/result.h"
#include "slam/detection/codes/dictionary.h"
#include "tools/printing/paper.h"

namespace waymark::printing {

struct MarkerSheetOptions {
  std::vector<int> ids;        // in this order
  double marker_size_m = 0.0;  // side of the black square
  PageOptions page;
  // White border that belongs to a marker, in cells of its code. Detectors need one cell.
  double quiet_cells = 1.0;
};

// As many markers a page as fit, each upright, with its white border, marks where to cut it out,
// and a line below that says dictionary, id and size. The page is turned where only that makes room
// for a marker. An Error says which id the dictionary lacks, or how much room there is.
[[nodiscard]] Result<std::vector<PdfPage>> markerSheets(const slam::Dictionary& dictionary,
                                                        const MarkerSheetOptions& options);

// The black cells of a marker whose black square has its top-left corner at left, top; side and
// place in millimetres. Cells side by side are one box.
void drawMarker(const slam::Dictionary& dictionary, int id, double left, double top, double side_mm,
                std::vector<Box>* boxes);

}  // namespace waymark::printing
