// What a frame may spend on the map.
#pragma once

#include <algorithm>

#include "slam/options.h"

namespace waymark::slam {

// Units of Options::work_per_frame. since_last_s: the time since the frame before, 0 for the first.
[[nodiscard]] inline double frameWork(const Options& options, double since_last_s) {
  constexpr double kUsual_s = 1.0 / 30.0;
  const double spare_us = 1e6 * std::max(since_last_s - kUsual_s, 0.0);
  const double most = std::max(options.most_work_per_frame, options.work_per_frame);
  return std::min(options.work_per_frame + options.spare_time_share * spare_us, most);
}

}  // namespace waymark::slam
