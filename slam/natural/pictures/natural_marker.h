// A natural marker: a flat picture in the scene (poster, sign, label) whose print is known (seed 2,
// section 3.1). What is computed of the picture alone is computed here, once.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include <Eigen/Core>

#include "base/image_view.h"
#include "base/result.h"
#include "slam/geometry/transform.h"
#include "slam/natural/pictures/grey_pyramid.h"
#include "slam/natural/pictures/picture_features.h"

namespace waymark::slam {

struct NaturalMarkerOptions {
  // Larger pictures are reduced to this, pixels of the longer side. Features of finer detail are
  // seen again from very near only, and what is aligned has fewer pixels (max_pixels there).
  int max_side_px = 512;
  // Of the shorter side: less has no room for features.
  int min_side_px = 48;
  // Standard deviation of the grey levels: less is a uniform sheet.
  double min_contrast = 4.0;
  // Of the picture as it is, and of each of the views below.
  int max_features = 500;
  int max_tilted_features = 150;
  // Features are also taken from the picture as it looks when it is tilted (Morel and Yu's ASIFT),
  // turned about so many axes; 0 for none. They are what is found from beyond 45 degrees.
  int tilted_views = 4;
  double tilt_factor = 2.0;  // 1 / cosine of the tilt, 60 degrees
  // That occur once in the picture. Fewer cannot be told from chance.
  int min_distinct_features = 30;
  // Largest share of features that occur elsewhere in the picture as well. Text repeats its letters
  // (up to some 0.7), patterns repeat all but their edges.
  double max_repeated_share = 0.85;
  // Two features are the same when their squared distance is less, SIFT only (a descriptor's length
  // is 512). The same feature in two views of a print differs by about 150^2, two unrelated ones by
  // 400^2 and more.
  int same_feature_distance2 = 130 * 130;
  FeatureOptions features;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// A picture's own figures, for people: how well it will do.
struct PictureQuality {
  double contrast = 0.0;  // standard deviation of the grey levels
  int features = 0;       // of these, those that occur once:
  int distinct_features = 0;
  [[nodiscard]] double repeatedShare() const {
    return features > 0 ? 1.0 - static_cast<double>(distinct_features) / features : 0.0;
  }
};

// Frame: origin at the picture's centre, x right, y up, z out of the print, as of a marker.
class NaturalMarker {
 public:
  // height_m: 0 takes it from the picture's shape. `known`: its features where they have been
  // computed before, of the same picture with the same options. The Error is one line without the
  // picture's name: uniform, self-similar, too small, no width.
  [[nodiscard]] static Result<NaturalMarker> create(ImageView image, double width_m,
                                                    double height_m,
                                                    const NaturalMarkerOptions& options = {},
                                                    const FeatureSet* known = nullptr);

  [[nodiscard]] double width_m() const { return width_m_; }
  [[nodiscard]] double height_m() const { return height_m_; }
  // The picture, reduced where it was too large.
  [[nodiscard]] const PicturePyramid& grey() const { return grey_; }
  // In pixels of level 0 of grey(); those of tilted views as they would be in the picture.
  [[nodiscard]] const FeatureSet& features() const { return features_; }
  [[nodiscard]] const PictureQuality& quality() const { return quality_; }
  // Metres on the print per pixel of the picture (geometric mean).
  [[nodiscard]] double pixel_m() const;
  // Where on the print (x right, y up) a feature is, metres.
  [[nodiscard]] Eigen::Vector2d featurePoint(std::size_t i) const;
  // Where in level 0 of grey() a point of the print is: pixels.
  [[nodiscard]] Eigen::Vector2d toPixel(const Eigen::Vector2d& point_m) const;
  // Pixels of level 0 per metre, along x and along y.
  [[nodiscard]] Eigen::Vector2d pixelsPerMetre() const;

 private:
  NaturalMarker() = default;

  double width_m_ = 0.0;
  double height_m_ = 0.0;
  PicturePyramid grey_;
  FeatureSet features_;
  PictureQuality quality_;
};

// Where it hangs, if that is known: surveyed, or found by the map.
struct PosedNaturalMarker {
  int id = -1;  // in the map: pictureId() of its name
  NaturalMarker marker;
  std::optional<Transform> T_w_m;
};

}  // namespace waymark::slam
