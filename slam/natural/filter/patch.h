// What a feature looks like: pieces of the image it was first seen in, warped to what they should
// look like now, and found again with sub-pixel accuracy and covariance.
//
// Levels: level 0 is the image, level 1 has half its size. A pixel x of level 0 is at
// (x - 0.5) / 2 of level 1.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include <Eigen/Core>

#include "base/image_view.h"

namespace waymark::slam {

struct PatchOptions {
  // Noise of a pixel, grey levels: what a match's covariance is made of where it fits better than
  // that. Typical cameras indoors have 2 to 3.
  double image_noise = 2.5;
  // What the fit does not show of a match's error, pixels of its level: interpolation ...
  double systematic_px = 0.05;
  // ... and a surface that lies otherwise than thought, for each unit by which the patch is
  // stretched or shrunk against the anchor's image. Measured on a rendered wall: matches are off by
  // 0.2 px at first and by 0.7 px when they have been stretched for long, whatever their fits say.
  double systematic_per_stretch_px = 0.5;
  // Correlation of the patch with what is found, 1 for the same but for gain and offset. Smaller
  // believes what looks otherwise, larger loses features in blur and at other angles.
  double min_correlation = 0.8;
  // Iterations of a match at most, and the step in pixels at which it has arrived.
  int max_iterations = 10;
  double converged_px = 0.03;
  // A match that goes further than this from where it began is none, pixels of its level.
  double max_shift_px = 4.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// Pixels of a patch's side.
inline constexpr int kPatchSide = 8;
inline constexpr int kPatchPixels = kPatchSide * kPatchSide;

// Of the image, around a feature: at both levels.
struct PatchSource {
  static constexpr int kSide = 32;
  using Pixels = std::array<std::uint8_t, kSide * kSide>;
  Pixels fine;
  Pixels coarse;
  Eigen::Vector2f centre_fine;  // where the feature is in them
  Eigen::Vector2f centre_coarse;
};

// pixel: of the image (level 0), a whole one. Beyond its border the image goes on as it ends.
void cutPatch(const ImageView& image, const ImageView& half, int x, int y, PatchSource* source);

// By how many pixels of the image it was cut from pixels of the image now move on, of level 0 both:
// u moves on by anchor_from_now u / (1 - bend . u).
struct PatchWarp {
  Eigen::Matrix2d anchor_from_now = Eigen::Matrix2d::Identity();
  // Of perspective, 1 / pixels: the far side of a slanted surface is smaller than the near one.
  Eigen::Vector2d bend = Eigen::Vector2d::Zero();
};

// As it should look now; all sums over its pixels are zero.
struct PatchTemplate {
  alignas(32) std::array<float, kPatchPixels> value;
  alignas(32) std::array<float, kPatchPixels> dx;
  alignas(32) std::array<float, kPatchPixels> dy;
  float mean = 0.0F;         // that was taken off
  float sum_squares = 0.0F;  // of value
  Eigen::Matrix3d inverse;   // of the normal equations of a shift and a gain

  // Of a match's place, for the given noise of both images together, pixels^2 of the level.
  [[nodiscard]] Eigen::Matrix2d covariance(double noise) const {
    return noise * noise * inverse.topLeftCorner<2, 2>();
  }
};

// level: that it will be looked for at. False where there is too little texture.
[[nodiscard]] bool warpPatch(const PatchSource& source, const PatchWarp& warp, int level,
                             PatchTemplate* patch);

struct PatchMatch {
  Eigen::Vector2d at = Eigen::Vector2d::Zero();          // pixels of the level
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of its noise, pixels^2 of the level
  double correlation = 0.0;
};

// From `start` (pixels of the level) to where it fits best, with gain and offset (Lucas and Kanade
// with the gradients of the template, all four unknowns linear). Empty where it does not fit.
[[nodiscard]] std::optional<PatchMatch> alignPatch(const ImageView& image,
                                                   const PatchTemplate& patch,
                                                   const Eigen::Vector2d& start,
                                                   const PatchOptions& options);

// The best correlation at whole steps within the ellipse d^T information d <= 1 about `centre`,
// at most `reach_px` away in either direction. Empty where none reaches options.min_correlation
// less a margin for what whole steps cost.
[[nodiscard]] std::optional<Eigen::Vector2d> searchPatch(const ImageView& image,
                                                         const PatchTemplate& patch,
                                                         const Eigen::Vector2d& centre,
                                                         const Eigen::Matrix2d& information,
                                                         int reach_px, const PatchOptions& options);

}  // namespace waymark::slam
