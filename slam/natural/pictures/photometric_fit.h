// One picture as expected over one image: residuals and normal equations of the pose and the light.
#pragma once

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/transform.h"
#include "slam/natural/pictures/expected_picture.h"
#include "slam/natural/pictures/grey_pyramid.h"

namespace waymark::slam {

// How a print is lit: seen = offset + gain(place) * expected. The gain is a polynomial of the
// second degree over the box (lamps, and the lens that darkens towards its corners): its
// coefficients for 1, x, y, x^2, xy, y^2 follow the offset. The place is from -1 to 1.
using Light = Eigen::Matrix<double, 7, 1>;

// Unknowns: the pose's delta (6), then the light's.
inline constexpr int kPhotometricUnknowns = 13;
using PhotometricVector = Eigen::Matrix<double, kPhotometricUnknowns, 1>;
using PhotometricMatrix = Eigen::Matrix<double, kPhotometricUnknowns, kPhotometricUnknowns>;

// A pixel that is compared.
struct PhotometricPixel {
  Eigen::Vector3d on_print;       // metres, z = 0
  Eigen::Matrix<double, 1, 6> J;  // d expected / d pose, grey levels
  // d expected / d blur's covariance (xx, xy, yy), grey levels per pixel squared of the level:
  // half the second derivatives, as heat flows.
  Eigen::Vector3f blur_J;
  float expected = 0.0F;             // grey level, blurred
  float x = 0.0F, y = 0.0F;          // place in the box, -1 to 1
  std::int16_t column = 0, row = 0;  // pixels of the level
};

// Sums of a block of pixels, which say how expected and seen grey levels hang together.
struct PixelBlock {
  int count = 0;
  double e = 0.0, s = 0.0, ee = 0.0, ss = 0.0, es = 0.0;  // of expected and seen

  void add(double expected, double seen);
  void add(const PixelBlock& other);
  // Standard deviation of what is expected, grey levels.
  [[nodiscard]] double contrast() const;
  [[nodiscard]] double correlation() const;
};
// A block's row and column.
using BlockPlace = std::pair<int, int>;
[[nodiscard]] inline BlockPlace blockOf(const PhotometricPixel& pixel, int block_px) {
  return {pixel.row / block_px, pixel.column / block_px};
}
// Fewer pixels of a block, at the picture's edge, say too little to be judged by.
inline constexpr int kLeastBlockPixels = 16;
using PixelBlocks = std::map<BlockPlace, PixelBlock>;

class PhotometricFit {
 public:
  // Of `blurred`, an expected picture with its grey levels blurred like the image, the pixels that
  // lie at least inside_px within the print. T_c_p: the pose it is expected from.
  PhotometricFit(const ExpectedPicture& expected, const std::vector<float>& blurred,
                 double inside_px, const Transform& T_c_p, const CameraModel& camera,
                 const GreyLevels& image);

  [[nodiscard]] const std::vector<PhotometricPixel>& pixels() const { return pixels_; }
  // Of the last computeResiduals(); not a number where the image ends.
  [[nodiscard]] const std::vector<float>& seen() const { return seen_; }
  [[nodiscard]] const std::vector<float>& residuals() const { return residuals_; }

  // Fills seen(), what the image has where the pixels are from T_c_p, and residuals(), that less
  // what is expected in this light.
  void computeResiduals(const Transform& T_c_p, const Light& light);
  // The light that explains what is seen from T_c_p, by least squares with Tukey's weights.
  [[nodiscard]] Light fitLight(const Transform& T_c_p, double outlier_sigmas);
  // What is seen from T_c_p, by blocks.
  [[nodiscard]] PixelBlocks blocks(const Transform& T_c_p, int block_px);
  // Leaves out the pixels of blocks that have texture, but of which the image shows nothing: what
  // hides the picture must not be fitted. Does nothing where hardly any would be left.
  void leaveOutHidden(const Transform& T_c_p, int block_px, double contrast, double correlation);

  // Median of the residuals' sizes as a standard deviation.
  [[nodiscard]] double robustSigma() const;
  // Mean of Tukey's cost of the residuals, 0 to 1; pixels beyond the image cost 1.
  [[nodiscard]] double meanCost(double cutoff) const;
  // Of the weighted residuals; J^T W J and J^T W r.
  void normalEquations(const Light& light, double cutoff, PhotometricMatrix* A,
                       PhotometricVector* b) const;
  // d residual / d unknowns of pixel i.
  [[nodiscard]] PhotometricVector jacobian(std::size_t i, const Light& light) const;
  // By how much the blur's covariance (xx, xy, yy, pixels squared of the level) has to change, the
  // light with it; zero where that cannot be told.
  [[nodiscard]] Eigen::Vector3d blurStep(const Light& light, double cutoff) const;

 private:
  const CameraModel& camera_;
  const GreyLevels& image_;
  int level_;
  std::vector<PhotometricPixel> pixels_;
  std::vector<float> seen_;
  std::vector<float> residuals_;
};

// The light's terms at a pixel: 1, then expected times 1, x, y, x^2, xy, y^2.
[[nodiscard]] inline Light lightTerms(const PhotometricPixel& p) {
  const double e = p.expected;
  Light terms;
  terms << 1.0, e, e * p.x, e * p.y, e * p.x * p.x, e * p.x * p.y, e * p.y * p.y;
  return terms;
}
// Of 1 grey level.
[[nodiscard]] inline double gainAt(const PhotometricPixel& p, const Light& light) {
  return light[1] + light[2] * p.x + light[3] * p.y + light[4] * p.x * p.x + light[5] * p.x * p.y +
         light[6] * p.y * p.y;
}

// Tukey's biweight: its weight, and the influence's derivative. t = (residual / cutoff)^2.
[[nodiscard]] inline double tukeyWeight(double t) { return t < 1.0 ? (1.0 - t) * (1.0 - t) : 0.0; }
[[nodiscard]] inline double tukeySlope(double t) {
  return t < 1.0 ? (1.0 - t) * (1.0 - 5.0 * t) : 0.0;
}

}  // namespace waymark::slam
