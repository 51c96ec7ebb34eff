// How much larger than their covariances say the residuals of camera poses are. Corners may err by
// more than their noise (a lens that is not quite known, bent paper, blur), and then covariances
// made from that noise are too small; but the residuals of one pose are too few to tell this from
// chance, above all with one or two markers in view.
#pragma once

#include <string>

namespace waymark::slam {

struct ResidualVarianceOptions {
  // How many residuals' worth of belief the corners' own covariances have at the start. Larger
  // takes longer to see that they are too small, smaller takes chance for noise.
  double prior_dof = 50.0;
  // The latest residuals that count. More is steadier, fewer follows what changes: with four
  // markers in view a frame has 26.
  double memory_dof = 1000.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// What chance cannot explain of one pose's residuals: their sum of squares over the 99 % quantile
// of a chi-square of so many degrees of freedom, at least 1. (The quantile by Wilson and Hilferty,
// within 2 %.)
[[nodiscard]] double unexplainedVariance(double chi2, double degrees_of_freedom);

// Of all poses so far, the latest most.
class ResidualVariance {
 public:
  explicit ResidualVariance(const ResidualVarianceOptions& options) : options_(options) {}

  // A pose's whitened squared residuals, summed up.
  void add(double chi2, double degrees_of_freedom);
  // Variance of a whitened residual, at least 1.
  [[nodiscard]] double value() const;

 private:
  ResidualVarianceOptions options_;
  double chi2_ = 0.0;
  double dof_ = 0.0;
};

}  // namespace waymark::slam
