// A calibration board on one page, true to scale.
#pragma once

#include "base/result.h"
#include "tools/calibration/board.h"
#include "tools/printing/paper.h"

namespace waymark::printing {

// The board as calibration::Board lays it out, upright, and what it is in words. The page is turned
// where the board fits only so. An Error says how much room there is.
// Precondition: board.invalidReason() is empty.
[[nodiscard]] Result<PdfPage> boardSheet(const calibration::BoardOptions& board,
                                         const PageOptions& options);

}  // namespace waymark::printing
