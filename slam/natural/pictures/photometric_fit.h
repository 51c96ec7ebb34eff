// One picture as expected over one image: residuals and normal equations of the pose and the light.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/transform.h"
#include "slam/natural/pictures/expected_picture.h"
#include "slam/natural/pictures/grey_pyramid.h"

namespace waymark::slam {

// Unknowns: the pose's delta (6), then the light's: gain, offset, slope to the right, slope down.
inline constexpr int kPhotometricUnknowns = 10;
using PhotometricVector = Eigen::Matrix<double, kPhotometricUnknowns, 1>;
using PhotometricMatrix = Eigen::Matrix<double, kPhotometricUnknowns, kPhotometricUnknowns>;

// seen = gain * expected + offset + slope . place, the place from -1 to 1 over the box.
struct Light {
  double gain = 1.0;
  double offset = 0.0;   // grey levels
  double slope_x = 0.0;  // grey levels from the box's middle to its edge
  double slope_y = 0.0;
};

// A pixel that is compared.
struct PhotometricPixel {
  Eigen::Vector3d on_print;          // metres, z = 0
  Eigen::Matrix<double, 1, 6> J;     // d expected / d pose, grey levels
  float expected = 0.0F;             // grey level, blurred
  float x = 0.0F, y = 0.0F;          // place in the box, -1 to 1
  std::int16_t column = 0, row = 0;  // pixels of the level
};

class PhotometricFit {
 public:
  // Of `blurred`, an expected picture with its grey levels blurred like the image, the pixels that
  // lie at least inside_px within the print. T_c_p: the pose it is expected from.
  PhotometricFit(const ExpectedPicture& expected, const std::vector<float>& blurred,
                 double inside_px, const Transform& T_c_p, const CameraModel& camera,
                 const GreyLevels& image);

  [[nodiscard]] const std::vector<PhotometricPixel>& pixels() const { return pixels_; }
  [[nodiscard]] const std::vector<float>& residuals() const { return residuals_; }

  // Fills residuals(): seen from T_c_p less what is expected; not a number where the image ends.
  // Returns how many there are.
  int computeResiduals(const Transform& T_c_p, const Light& light);
  // Gain and offset by least squares at T_c_p.
  [[nodiscard]] Light fitLight(const Transform& T_c_p);
  // Median of the residuals' sizes as a standard deviation.
  [[nodiscard]] double robustSigma() const;
  // Mean of Tukey's cost of the residuals, 0 to 1; pixels beyond the image cost 1.
  [[nodiscard]] double meanCost(double cutoff) const;
  // Of the weighted residuals; J^T W J and J^T W r.
  void normalEquations(const Light& light, double cutoff, PhotometricMatrix* A,
                       PhotometricVector* b) const;
  // d residual / d unknowns of pixel i.
  [[nodiscard]] PhotometricVector jacobian(std::size_t i, const Light& light) const;

 private:
  const CameraModel& camera_;
  const GreyLevels& image_;
  int level_;
  std::vector<PhotometricPixel> pixels_;
  std::vector<float> seen_;  // of the last computeResiduals()
  std::vector<float> residuals_;
};

// Tukey's biweight: its weight, and the influence's derivative. t = (residual / cutoff)^2.
[[nodiscard]] inline double tukeyWeight(double t) { return t < 1.0 ? (1.0 - t) * (1.0 - t) : 0.0; }
[[nodiscard]] inline double tukeySlope(double t) {
  return t < 1.0 ? (1.0 - t) * (1.0 - 5.0 * t) : 0.0;
}

}  // namespace waymark::slam
