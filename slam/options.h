// Every decision constant of the SLAM, nested as its stages are. Each: meaning, unit, default, and
// what moving it trades.
#pragma once

#include <string>

namespace waymark::slam {

struct Options {
  // Side of the printed black square, metres. There is no sensible default.
  double marker_size_m = 0.0;

  // Rule of the field: a pose is unambiguous when the other IPPE solution's squared reprojection
  // error is at least this many times larger (tau_e of seed 1, section 5). Larger is safer and
  // starts later.
  double ambiguity_ratio = 3.0;

  // Empty when usable, else which option is wrong and why.
  [[nodiscard]] std::string invalidReason() const;
};

}  // namespace waymark::slam
