// Maps in pieces: when a new one is begun, and what connects two (beyond seed 1).
#pragma once

#include <string>

namespace waymark::slam {

struct PieceOptions {
  // Off: there is one piece, and a frame without any of its markers has no pose; for callers that
  // do not ask of a pose which piece it is in. Pieces of a map that is given are there all the
  // same.
  bool begin = false;
  // At most so many at a time. Each rests, and costs memory only, while the camera is not in it.
  int max_pieces = 200;

  // A camera that was lost for longer than this, seconds, may have been carried anywhere meanwhile:
  // found again by one marker among unknown ones, it begins a new piece with these. Shorter makes
  // more pieces where views are poor, longer trusts an id that hangs twice for that long.
  double carried_s = 1.5;

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

  // One id in two rooms: when a print is taken for another one than the map knows, as nothing is in
  // view of what hangs around that (other_print.h). Larger angles and ratios find out sooner, and
  // may be wrong where a wall stands between.
  struct OtherPrint {
    // Seen from about the same place: so much in direction, and times so much in distance.
    double max_angle_rad = 0.35;
    double max_distance_ratio = 1.5;
    // What ought to be in view: so far from the image's border, of its width, from no more than so
    // far aside, and no smaller than so much of the print itself.
    double border_share = 0.03;
    double max_slant_rad = 1.0;
    double least_side = 0.8;
    // At least so many of these missing; one, where another marker is in its place.
    int missing = 2;
    // Banned, as an id that hangs twice, after so many frames and so long. Until then it is left
    // out of these frames.
    int frames = 4;
    double seconds = 0.3;
  };
  OtherPrint other_print;
  // Markers of another piece seen from poses that natural features carry: so many such frames for
  // each, which count as one together, and no nearer to each other.
  struct Bridge {
    int links = 4;
    double interval_s = 0.3;
  };
  Bridge bridge;
  // What joining two pieces may spend of a frame, in the units of Options::work_per_frame.
  // Meanwhile the map does not grow: more is done sooner, and makes these frames longer.
  double join_cost_per_frame = 600.0;
  // A joint is on trial: frames that show markers of both pieces, at most one in so many seconds,
  // are compared with the two as they were.
  struct Trial {
    double interval_s = 0.25;
    // Undone when at least so many frames, and more than 1 - min_share of all since, contradict.
    int against = 3;
    // Believed after so many frames, or once so many later joints are on trial.
    int frames = 12;
    int joints = 4;
  };
  Trial trial;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

}  // namespace waymark::slam
