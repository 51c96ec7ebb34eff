// From features to pictures: which pictures an image may show, and where in it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "slam/natural/pictures/descriptor_index.h"
#include "slam/natural/pictures/natural_marker.h"

namespace waymark::slam {

struct PictureMatcherOptions {
  // A feature of the image is compared with this many neighbours less one; the last is what chance
  // comes to. So a print that is in the set several times is still found.
  int neighbours = 6;
  // A neighbour counts when its distance is at most this part of the last one's (Lowe's ratio test;
  // of the distances, not their squares).
  double distance_ratio = 0.85;
  // Pictures looked at more closely, those with most votes first, and the votes that takes.
  int most_candidates = 16;
  int min_votes = 5;
  // Of four matches each, at most. With 3 of 10 matches right, 570 make a right one 99 % sure.
  int max_samples = 800;
  // Matches that agree with the picture's place, at least; what is left of chance is found out on
  // the image itself.
  int min_inliers = 5;
  // A match agrees within this, pixels at the image centre; more for features so large that they
  // are placed less well, by this part of their diameter.
  double inlier_px = 2.5;
  double inlier_share_of_size = 0.15;
  // How far size (as a factor) and direction (radians) of a feature may be from what the picture's
  // place makes of them: tilted prints change both.
  double size_factor = 2.5;
  double direction_rad = 0.9;
  // The same picture is searched for again where it has been found already, up to so many times.
  int most_instances = 3;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// A feature of the image, its lens undone.
struct ImageFeature {
  Eigen::Vector2d normalized = Eigen::Vector2d::Zero();
  double size = 0.0;                                     // normalized, too
  Eigen::Vector2d direction = Eigen::Vector2d::UnitX();  // unit length
};

// A feature of the image and one of a picture.
struct PictureFeatureMatch {
  int image_feature = -1;
  int picture_feature = -1;
  double ratio = 1.0;  // of its distance to chance's
};

// A picture that may be there. H maps points of the print (x right, y up, metres, 1) to normalized
// image coordinates.
struct PictureCandidate {
  int picture = -1;
  Eigen::Matrix3d H = Eigen::Matrix3d::Identity();
  std::vector<PictureFeatureMatch> inliers;  // no feature twice
};

// The matches of each picture, by the picture's place in the index; the strongest first.
[[nodiscard]] std::vector<std::vector<PictureFeatureMatch>> matchFeatures(
    const FeatureSet& image, const DescriptorIndex& index, std::size_t pictures,
    const PictureMatcherOptions& options = {});

// Where in the image a picture is that these matches speak for; several places where it is printed
// more than once. Random samples of four (RANSAC), the best matches first, from the seed.
// focal_px converts pixels to normalized units.
[[nodiscard]] std::vector<PictureCandidate> locatePicture(
    int picture, const NaturalMarker& marker, std::span<const ImageFeature> image,
    std::vector<PictureFeatureMatch> matches, double focal_px, std::uint64_t seed,
    const PictureMatcherOptions& options = {});

// The places of those pictures that have the votes, best supported first.
[[nodiscard]] std::vector<PictureCandidate> locatePictures(
    std::span<const NaturalMarker* const> pictures, std::span<const ImageFeature> image,
    std::vector<std::vector<PictureFeatureMatch>> matches, double focal_px,
    const PictureMatcherOptions& options = {});

}  // namespace waymark::slam
