// How much of what a frame shows is looked at closely, so that its time has a bound whatever is in
// view: a facade, a loudspeaker's grille, leaves. Counted and never timed. What is left for later
// frames has its turn there.
#pragma once

#include <limits>
#include <string>

namespace waymark::slam {

// Ordinary frames need less of everything: rooms of markers at 640x480 at most 17,000 runs, 250
// regions and 50 candidates. The defaults are what doubles an ordinary full scan's time at most.
struct ScanBudgetOptions {
  // Runs of dark pixels in the image's rows. An image with more is too busy to be searched as a
  // whole: it is searched in turns. About 30 ns each, when they lie dense.
  int runs = 20'000;
  int runs_per_mpx = 20'000;  // and so many for a million pixels of the image
  // Dark regions whose outlines are fitted by quads. About 1 us each.
  int regions = 300;
  int regions_per_mpx = 400;
  // Candidates: quads that are looked at for a marker. About 5 us each.
  int candidates = 50;
  int candidates_per_mpx = 50;
  // Of these, those with a border and no code that are looked at closely, by their edges or, found
  // in a reduced image, in the whole one, and are no markers all the same. About 30 us each.
  int futile_fits = 10;
  int futile_fits_per_mpx = 16;
  // Of regions and candidates, where there are too many, the share that has its turn; the others
  // are the most promising ones. Larger finds what looks like its surroundings sooner, and what
  // does not later.
  double turn_share = 0.5;
  // Fits are made as candidates come until they have spent this share; with the rest, and with all
  // of them in an image that is known to be busy, the ones whose codes are nearest to a marker's.
  double first_come_share = 0.5;
  // What is most like a marker: at least so much of it is light, a share of its area (codes are
  // half black, and have a border) ...
  double promising_light = 0.25;
  // ... and it is so large, pixels: larger ones are no easier to read.
  double promising_px = 40.0;
  // Sides as rough as this have no promise: pixels in a row by which the outline leaves a convex
  // shape. Leaves that hang together have 1 or more, a marker's sides with their noise none.
  double hopeless_roughness = 0.5;
  // A code's likeness to a marker's goes from 1, no wrong bit, to 0, half of them wrong; so much it
  // is where the border is too rough for a look at the code: small markers, corners not yet exact.
  double rough_border_likeness = 0.6;
  // A search for one lost marker may spend this share of what is left, so that many do not leave
  // nothing to the rest of the image.
  double lost_marker_share = 0.25;
  // A search, however small, may look at so many regions and candidates: those around a marker's
  // place, mostly its neighbours and what is printed in it.
  int least_regions = 64;
  int least_candidates = 8;
  int least_fits = 4;
  // Frames that the reduced sizes of a busy image are spread over at least. Its full size takes
  // twice as many: 0.4 s at 30 Hz.
  int busy_frames = 6;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// What may still be looked at.
struct ScanBudget {
  static constexpr int kUnlimited = std::numeric_limits<int>::max();

  int runs = kUnlimited;
  int regions = kUnlimited;
  int candidates = kUnlimited;
  int futile_fits = kUnlimited;
  int first_come_fits = kUnlimited;  // of these, made as candidates come

  // Of a frame with images of this size.
  [[nodiscard]] static ScanBudget ofFrame(const ScanBudgetOptions& options, int width, int height);
};

}  // namespace waymark::slam
