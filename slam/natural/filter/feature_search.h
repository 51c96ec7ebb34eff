// One feature looked for in an image: its patch warped to what it should look like now, searched
// for where it may be, and measured at the finest size of the image that shows it.
#pragma once

#include <array>
#include <optional>

#include <Eigen/Core>

#include "base/image_view.h"
#include "slam/natural/filter/feature_filter.h"
#include "slam/natural/filter/patch.h"

namespace waymark::slam {

// The image, and the same at half and at a quarter of its size.
using ImageLevels = std::array<ImageView, 3>;

// From pixels of level 0 to those of a level, and back.
[[nodiscard]] Eigen::Vector2d onLevel(const Eigen::Vector2d& pixel, int level);
[[nodiscard]] Eigen::Vector2d fromLevel(const Eigen::Vector2d& at, int level);

// Standard deviation along the longest axis.
[[nodiscard]] double longestSigma(const Eigen::Matrix2d& covariance);

// What a feature looks like.
struct FeatureLook {
  PatchSource source;
  // d normalized / d pixel of the anchor's image at the feature.
  Eigen::Matrix2d uv_from_pixel = Eigen::Matrix2d::Zero();
  Eigen::Vector2d surface = Eigen::Vector2d::Zero();  // surfaceGradient
};

// How far off a feature may be: half sizes of its ellipse in standard deviations, and at most in
// pixels of the image.
struct SearchReach {
  double sigmas = 3.0;
  double max_px = 40.0;
};

struct FoundFeature {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of the images' noise, pixels^2
  double systematic_px = 0.0;  // sigma of the error that the fit does not show (PatchOptions)
  double stretch = 0.0;        // of the patch against the anchor's image, 0 for none
};

// How the patch of a feature is warped on its surface as it lies. rho: its inverse depth. Empty
// where it would look otherwise: at less than a third of its size, or at more than three times it.
[[nodiscard]] std::optional<PatchWarp> warpOf(const FeatureLook& look, double rho,
                                              const ExpectedFeature& expected);

// Empty where it is not found.
[[nodiscard]] std::optional<FoundFeature> findFeature(const ImageLevels& levels,
                                                      const FeatureLook& look, double rho,
                                                      const ExpectedFeature& expected,
                                                      const SearchReach& reach,
                                                      const PatchOptions& options);

}  // namespace waymark::slam
