// Recall as a figure: a panel for each detector and noise, sides across and blur down.
#pragma once

#include <string>
#include <vector>

namespace waymark::bench {

struct RecallPanel {
  std::string detector;
  double noise_sigma = 0.0;     // grey levels
  std::vector<double> percent;  // found: by blur, and of each by side
};

// SVG. Panels of one noise after the other, as many detectors in each row of them.
[[nodiscard]] std::string recallFigure(const std::vector<RecallPanel>& panels,
                                       const std::vector<double>& sides_px,
                                       const std::vector<double>& blurs_px);

}  // namespace waymark::bench
