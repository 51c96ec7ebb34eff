#include "slam/pieces/piece_options.h"

#include "slam/option_checks.h"

namespace waymark::slam {

std::string PieceOptions::invalidReason() const {
  return firstUnmet({
      {max_pieces >= 1, "a map has at least 1 piece"},
      {isNotNegative(carried_s), "the time to be carried away must not be negative"},
      {ambiguity_ratio >= 1.0 && ratio_of_few_views >= 1.0, "ambiguity ratios must be at least 1"},
      {enough_views >= 1, "pieces need at least 1 frame that connects them"},
      {isPositive(other_rotation_rad), "the turn to another way must be positive"},
      {isNotNegative(bend_rad) && isNotNegative(bend_per_depth),
       "how much pieces bend must not be negative"},
      {isPositive(max_chi2), "the chi-square of two pieces must be positive"},
      {isShare(min_share), "the share of frames that agree must be from 0 to 1"},
      {max_views >= 1, "pieces need at least 1 frame that connects them"},
      {isPositive(other_print.max_angle_rad) && other_print.max_distance_ratio >= 1.0 &&
           isNotNegative(other_print.border_share) && isPositive(other_print.max_slant_rad) &&
           isNotNegative(other_print.least_side) && other_print.missing >= 1 &&
           other_print.frames >= 1 && isNotNegative(other_print.seconds),
       "what tells another print of one id must be positive"},
      {bridge.links >= 1 && isNotNegative(bridge.interval_s),
       "pieces need at least 1 carried frame"},
      {isPositive(join_cost_per_frame), "the cost of joining pieces must be positive"},
      {isNotNegative(trial.interval_s) && trial.against >= 1 && trial.frames >= 1 &&
           trial.joints >= 1,
       "the trial of a joint must be positive"},
  });
}

}  // namespace waymark::slam
