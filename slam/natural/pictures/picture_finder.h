// The relocaliser's step (seed 2, section 3.1), without its thread: an image in, the pictures that
// it shows out, each with the camera's pose in the picture's frame. What features propose, the
// image itself refines and verifies.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/image_view.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"
#include "slam/natural/pictures/descriptor_index.h"
#include "slam/natural/pictures/natural_marker.h"
#include "slam/natural/pictures/picture_alignment.h"
#include "slam/natural/pictures/picture_matcher.h"
#include "slam/natural/pictures/pixel_rays.h"

namespace waymark::slam {

struct PictureFinderOptions {
  // Of an image. Fewer are quicker, and miss small pictures in front of a busy wall.
  int max_image_features = 1500;
  // Of expected and seen grey levels where they agree, at least; and the part of the picture in the
  // image that has to agree (the rest is hidden), in at least so many blocks.
  double min_correlation = 0.85;
  double min_agreeing_share = 0.35;
  int min_agreeing_blocks = 8;
  // Where less than this share agrees, the middle one of the blocks that do has to by this. A print
  // of the same layout has its lines and margins in the same places: 0.76 to 0.87. One that is
  // hidden in part shows the rest as it is: 0.97 and more, 0.88 where it is not so much hidden.
  double whole_share = 0.65;
  double min_block_correlation = 0.92;
  // Whatever the grey levels say: a picture is not seen flatter than this, radians from its normal.
  double max_tilt_rad = 1.40;
  // The other pose that a plane leaves open is one of its own when turned by this, radians; and
  // this is added to both errors before their ratio is taken, as of squares.
  double other_rotation_rad = 0.02;
  double evidence_floor = 5.0;
  // Of two pictures in one place the worse is refuted by so much evidence (a difference of
  // chi-squares); by less, the two look alike.
  double refuting_evidence = 30.0;
  DescriptorIndexOptions index;
  FeatureOptions features;  // of the same kind as the pictures'
  PictureMatcherOptions matcher;
  PictureAlignmentOptions alignment;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct FoundPicture {
  int picture = -1;  // its place in the set
  PictureAlignment alignment;
  // The other pose, where the image does not exclude that there is one, and how much worse it
  // explains the image, as of squares (SquarePose::ratio): 1 is a coin toss.
  std::optional<Transform> other_T_c_p;
  Matrix6d other_covariance = Matrix6d::Zero();
  double ambiguity_ratio = 1e6;
  // Pictures of the set that explain this place about as well: which of them it is, is open.
  std::vector<int> alike;
  // How often this picture was found in the image: which of them is the one in the map, is open.
  int instances = 1;
  int matches = 0;  // features that agreed
};

struct PictureSearch {
  std::vector<FoundPicture> found;  // best supported first
  int image_features = 0;
  int proposed = 0;   // places that features spoke for; what is not found of them:
  int unaligned = 0;  // was lost by the alignment
  int refused = 0;    // did not look like the picture
  int refuted = 0;    // another picture looked more like it
};

// Not to be shared between threads. Deterministic: what was searched before changes nothing.
class PictureFinder {
 public:
  // The markers must outlive it. Precondition: options.invalidReason() is empty.
  explicit PictureFinder(std::span<const NaturalMarker> markers,
                         const PictureFinderOptions& options = {});

  // Among those pictures (places in the set, ascending); none: among all.
  [[nodiscard]] PictureSearch find(ImageView image, const CameraModel& camera,
                                   std::span<const int> candidates = {});

 private:
  void takeSubset(std::span<const int> candidates);
  [[nodiscard]] std::vector<ImageFeature> undistorted(const FeatureSet& features,
                                                      const CameraModel& camera,
                                                      FeatureSet* kept) const;
  [[nodiscard]] std::optional<FoundPicture> verified(const PictureCandidate& candidate,
                                                     std::span<const ImageFeature> features,
                                                     const GreyPyramid& image,
                                                     PictureSearch* search);
  [[nodiscard]] bool looksRight(const PictureAlignment& alignment) const;
  void addRival(const NaturalMarker& marker, const GreyPyramid& image, FoundPicture* found);
  [[nodiscard]] bool sharePlace(const FoundPicture& a, const FoundPicture& b) const;
  void settleRivals(PictureSearch* search) const;

  std::span<const NaturalMarker> markers_;
  PictureFinderOptions options_;
  DescriptorIndex all_;
  DescriptorIndex some_;  // of subset_
  std::vector<int> subset_;
  std::optional<PixelRays> rays_;  // of the camera used last
};

}  // namespace waymark::slam
