// Maps in pieces: when a new one is begun, and what connects two (beyond seed 1).
#pragma once

#include <string>

namespace waymark::slam {

struct PieceOptions {
  // Off: there is one piece, and a frame without any of its markers has no pose; for callers that
  // do not tell of a pose which piece it is in. Pieces of a map that is given are there all the
  // same.
  bool begin = false;
  // At most so many at a time. Each rests, and costs memory only, while the camera is not in it.
  int max_pieces = 200;

  // Of two ways in which two pieces may lie to each other the better one must explain the frames
  // with markers of both so many times better (tau_e) ...
  double ambiguity_ratio = 3.0;
  // ... and as long as there are fewer such frames than this, so many times: one image must not
  // decide between poses of single markers unless they are beyond doubt.
  int enough_views = 3;
  double ratio_of_few_views = 20.0;
  // What counts as another way, radians: more than noise turns one, less than a marker's two poses
  // differ by.
  double other_rotation_rad = 0.1;
  // How well a piece is known to be in shape between its markers, beyond what the corners say:
  // added to where each frame is in each piece, radians and a share of the distance to the markers.
  double bend_rad = 0.005;
  double bend_per_depth = 0.005;
  // Chi-square (6 degrees of freedom) from which a frame contradicts, and counts no more: 22.5 is
  // the 99.9 % quantile. Larger believes pieces that do not fit, smaller refuses bent ones.
  double max_chi2 = 22.5;
  // At least this share of the frames must not contradict, and of the markers in each.
  double min_share = 0.75;
  // Frames looked at for two pieces, at most. More is surer and costs time.
  int max_views = 12;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

}  // namespace waymark::slam
