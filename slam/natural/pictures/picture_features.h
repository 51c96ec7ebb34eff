// Local features of an image: places with a size, a direction and a description of what is there.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/image_view.h"

namespace waymark::slam {

enum class FeatureKind { kSift, kBrisk, kAkaze, kOrb };

struct Feature {
  float x_px = 0.0F;  // pixel centres at integers
  float y_px = 0.0F;
  float size_px = 0.0F;    // diameter of what is described
  float angle_rad = 0.0F;  // from x towards y, that is clockwise in the image
  float strength = 0.0F;   // of the detector; comparable within one image only
};

// Descriptors lie one after the other, `descriptor_bytes` each. SIFT's are compared by their
// squared Euclidean distance, the others' by the bits in which they differ.
struct FeatureSet {
  FeatureKind kind = FeatureKind::kSift;
  int descriptor_bytes = 0;
  std::vector<Feature> features;
  std::vector<std::uint8_t> descriptors;
  // So many, at the front, are of the picture as it is; the others of views of it.
  std::size_t upright = 0;

  [[nodiscard]] std::size_t size() const { return features.size(); }
  [[nodiscard]] const std::uint8_t* descriptor(std::size_t i) const {
    return descriptors.data() + i * static_cast<std::size_t>(descriptor_bytes);
  }
  // At the back; of descriptor_bytes.
  void add(const Feature& feature, const std::uint8_t* its_descriptor) {
    features.push_back(feature);
    descriptors.insert(descriptors.end(), its_descriptor, its_descriptor + descriptor_bytes);
  }
};

struct FeatureOptions {
  // SIFT finds pictures of 60 to 90 px in 91 of 100 views, BRISK in 83 with two and a half times
  // the error of the corners, ORB in 22, AKAZE in 6 (tests/bench/natural_markers).
  FeatureKind kind = FeatureKind::kSift;
  // Least contrast of a feature, SIFT only, as OpenCV defines it. Smaller finds more on blurred and
  // dark prints, and costs time.
  double sift_contrast = 0.02;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// At most `most` features. Large ones are rare and found from afar, so the places are shared
// out over the sizes: of each octave the strongest. Equal images give equal features.
[[nodiscard]] FeatureSet extractFeatures(ImageView image, std::size_t most,
                                         const FeatureOptions& options = {});

// How far two descriptors are apart: squared Euclidean for SIFT, else bits.
[[nodiscard]] int descriptorDistance(FeatureKind kind, const std::uint8_t* a, const std::uint8_t* b,
                                     int bytes);

}  // namespace waymark::slam
