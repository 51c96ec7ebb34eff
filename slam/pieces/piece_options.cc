#include "slam/pieces/piece_options.h"

#include "slam/option_checks.h"

namespace waymark::slam {

std::string PieceOptions::invalidReason() const {
  return firstUnmet({
      {max_pieces >= 1, "a map has at least 1 piece"},
      {ambiguity_ratio >= 1.0 && ratio_of_few_views >= 1.0, "ambiguity ratios must be at least 1"},
      {enough_views >= 1, "pieces need at least 1 frame that connects them"},
      {isPositive(other_rotation_rad), "the turn to another way must be positive"},
      {isNotNegative(bend_rad) && isNotNegative(bend_per_depth),
       "how much pieces bend must not be negative"},
      {isPositive(max_chi2), "the chi-square of two pieces must be positive"},
      {isShare(min_share), "the share of frames that agree must be from 0 to 1"},
      {max_views >= 1, "pieces need at least 1 frame that connects them"},
  });
}

}  // namespace waymark::slam
