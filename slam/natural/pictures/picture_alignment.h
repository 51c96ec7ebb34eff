// A picture's pose from the image itself: grey levels of the print, warped by the pose and blurred
// like the image, laid over the image until they fit. Gauss-Newton with the derivatives of the
// expected image (the inverse compositional way round: those of the camera's image are noisy), from
// coarse to fine; the light on the print is unknown beside the pose.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "slam/geometry/transform.h"
#include "slam/natural/pictures/expected_picture.h"
#include "slam/natural/pictures/grey_pyramid.h"
#include "slam/natural/pictures/natural_marker.h"
#include "slam/natural/pictures/pixel_rays.h"

namespace waymark::slam {

struct PictureAlignmentOptions {
  // Pixels compared, at most: of larger pictures the image is reduced. 15 000 have what there is
  // to know; time grows with their number.
  int max_pixels = 15000;
  // Of the coarsest level, at least: less does not hold the pose.
  int min_pixels = 250;
  int max_levels = 3;
  // Per level the expected image is made anew so many times, and fitted in so many steps.
  int renders = 2;
  int iterations = 12;
  // A pixel's influence ends at this many sigma (Tukey's biweight; 4.685 keeps 95 % of the
  // efficiency).
  double outlier_sigmas = 4.685;
  // The image's noise is never less than this, grey levels: rounding alone makes 0.29.
  double min_noise = 0.4;
  // The blur is looked for from these on, sigma in pixels, ascending: the best of them, then with
  // a width and a direction of its own (a moving camera's), within the first and the last.
  std::vector<double> blurs_px = {0.3, 0.6, 0.9, 1.4, 2.1, 3.2};
  // Errors that the picture's pixels have in common, of each of its corners, pixels of the level
  // that was compared: lens model, bent paper, a crop that is not exact, how prints are sampled.
  double systematic_sigma_px = 0.025;
  // The same from a blur that is no Gaussian, per square pixel of its covariance: a moving camera's
  // is a streak. 8 pixels of motion so make 0.1.
  double blur_sigma_per_px2 = 0.015;
  // Blocks of pixels in which residuals hang together, pixels.
  int block_px = 8;
  // A block has texture when what is expected varies by this, grey levels (standard deviation), and
  // agrees when it correlates with the image by that.
  double block_contrast = 4.0;
  double block_correlation = 0.6;
  // With a smaller share of agreeing blocks after the first fit, given up.
  double hopeless_share = 0.15;
  // With a smaller one at the end, the blocks are looked for in the image, so many pixels of the
  // level each way, and where they correlate by so much the picture is fitted from there: lines of
  // text look alike, and a fit may slip by one of them.
  double rematch_share = 0.95;
  int rematch_reach_px = 6;
  double rematch_correlation = 0.8;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct PictureAlignment {
  Transform T_c_p;
  // Of T_c_p.retract's delta (dp in metres, dtheta in radians, in the camera's frame): from the
  // residuals, with what they have in common, and the systematic error.
  Matrix6d covariance = Matrix6d::Identity();
  double noise = 0.0;    // grey levels, robust
  double blur_px = 0.0;  // sigma, in its widest direction
  int pixels = 0;        // compared
  // How much worse than independent the residuals are, at least 1.
  double dependence = 1.0;
  // Of each corner, what its pixels have in common (the options' systematic errors), pixels of the
  // image.
  double systematic_px = 0.0;
  // Mean of the squared residuals, each cut off at outlier_sigmas, in grey levels squared.
  double cut_square = 0.0;

  // The picture's part in the image, 0 to 1.
  double in_image = 0.0;
  // Of the blocks with texture, those that agree; and how many there are.
  double agreeing_share = 0.0;
  int textured_blocks = 0;
  [[nodiscard]] double agreeingBlocks() const { return agreeing_share * textured_blocks; }
  // Of expected and seen grey levels, over the blocks that agree, and within the middle one of
  // them: what is hidden cuts through some.
  double correlation = 0.0;
  double block_correlation = 0.0;
};

// Empty when the picture is not in the image from `start`, or the alignment comes to nothing.
[[nodiscard]] std::optional<PictureAlignment> alignPicture(
    const NaturalMarker& marker, const GreyPyramid& image, const Transform& start, PixelRays* rays,
    const PictureAlignmentOptions& options = {});

// How much better `best` explains the image than `rival`: the difference of their chi-squares, at
// the noise of the better one.
[[nodiscard]] double evidenceAgainst(const PictureAlignment& rival, const PictureAlignment& best,
                                     const PictureAlignmentOptions& options = {});

// The same of two poses of one picture: what moves its corners from the one to the other may be a
// systematic error, which no number of pixels averages away.
[[nodiscard]] double evidenceAgainstPose(const NaturalMarker& marker, const CameraModel& camera,
                                         const PictureAlignment& rival,
                                         const PictureAlignment& best,
                                         const PictureAlignmentOptions& options = {});

}  // namespace waymark::slam
