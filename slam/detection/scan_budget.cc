#include "slam/detection/scan_budget.h"

#include "slam/option_checks.h"

namespace waymark::slam {

std::string ScanBudgetOptions::invalidReason() const {
  return firstUnmet({
      {runs >= 0 && runs_per_mpx >= 0, "the runs of a frame must not be negative"},
      {regions >= 0 && regions_per_mpx >= 0, "the regions of a frame must not be negative"},
      {candidates >= 0 && candidates_per_mpx >= 0,
       "the candidates of a frame must not be negative"},
      {futile_fits >= 0 && futile_fits_per_mpx >= 0,
       "the futile fits of a frame must not be negative"},
      {isShare(turn_share) && isShare(first_come_share),
       "the shares of what has its turn and of what comes first must be from 0 to 1"},
      {isPositive(promising_light) && isPositive(promising_px) && isPositive(hopeless_roughness),
       "light share, size and roughness of what is promising must be positive"},
      {isShare(rough_border_likeness), "the likeness of a rough border must be from 0 to 1"},
      {isShare(lost_marker_share), "the share of a lost marker must be from 0 to 1"},
      {least_regions >= 1 && least_candidates >= 1 && least_fits >= 1,
       "a search must be allowed at least 1 region, 1 candidate and 1 fit"},
      {busy_frames >= 2, "a busy image takes at least 2 frames"},
  });
}

ScanBudget ScanBudget::ofFrame(const ScanBudgetOptions& options, int width, int height) {
  const double mpx = 1e-6 * width * height;
  const auto sum = [mpx](int fixed, int per_mpx) {
    return static_cast<int>(fixed + mpx * per_mpx);
  };
  return {sum(options.runs, options.runs_per_mpx), sum(options.regions, options.regions_per_mpx),
          sum(options.candidates, options.candidates_per_mpx),
          sum(options.futile_fits, options.futile_fits_per_mpx), ScanBudget::kUnlimited};
}

}  // namespace waymark::slam
