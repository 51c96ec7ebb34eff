#include "slam/natural/pictures/picture_blur.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace waymark::slam {
namespace {

// The blur of that covariance, pixels squared: a lens's Gaussian, as wide as the covariance is
// narrow, drawn out evenly along its wide direction, as by a camera that moves while it exposes. A
// streak turns light and dark around where lines are as far apart as half its length is; no
// Gaussian does.
cv::Mat blurKernel(const Eigen::Matrix2d& covariance) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen;
  eigen.computeDirect(covariance);
  const double lens = eigen.eigenvalues()[0];  // the narrower one
  // Of an even streak the variance is a twelfth of its length squared.
  const double length = std::sqrt(12.0 * std::max(0.0, eigen.eigenvalues()[1] - lens));
  const Eigen::Vector2d way = length * eigen.eigenvectors().col(1);
  const int steps = 1 + static_cast<int>(std::ceil(2.0 * length));
  const int reach =
      std::max(1, static_cast<int>(std::ceil(0.5 * length + 3.0 * std::sqrt(std::max(0.0, lens)))));
  cv::Mat kernel = cv::Mat::zeros(2 * reach + 1, 2 * reach + 1, CV_32F);
  for (int i = 0; i < steps; ++i) {
    const Eigen::Vector2d centre = ((i + 0.5) / steps - 0.5) * way;
    for (int y = -reach; y <= reach; ++y) {
      for (int x = -reach; x <= reach; ++x) {
        const double d2 = (Eigen::Vector2d(x, y) - centre).squaredNorm();
        kernel.at<float>(y + reach, x + reach) += static_cast<float>(std::exp(-0.5 * d2 / lens));
      }
    }
  }
  return kernel / cv::sum(kernel)[0];
}

}  // namespace

double widestBlur(const Eigen::Matrix2d& covariance) {
  const double mean = 0.5 * covariance.trace();
  const double root = std::sqrt(std::max(0.0, mean * mean - covariance.determinant()));
  return std::sqrt(std::max(0.0, mean + root));
}

Eigen::Matrix2d limitedBlur(const Eigen::Matrix2d& covariance, double least_sigma,
                            double most_sigma) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen;
  eigen.computeDirect(covariance);
  const Eigen::Vector2d widths =
      eigen.eigenvalues().cwiseMax(least_sigma * least_sigma).cwiseMin(most_sigma * most_sigma);
  return eigen.eigenvectors() * widths.asDiagonal() * eigen.eigenvectors().transpose();
}

std::vector<float> blurredPicture(const ExpectedPicture& expected, const Eigen::Matrix2d& blur) {
  constexpr double kNothing_px = 0.2;  // narrower than pixels can show
  if (widestBlur(blur) < kNothing_px) return expected.grey;
  const cv::Mat in(expected.height, expected.width, CV_32F,
                   const_cast<float*>(expected.grey.data()));
  std::vector<float> out(expected.grey.size());
  cv::Mat result(expected.height, expected.width, CV_32F, out.data());
  cv::filter2D(in, result, CV_32F, blurKernel(limitedBlur(blur, 0.5 * kNothing_px, 1e3)),
               cv::Point(-1, -1), 0.0, cv::BORDER_REPLICATE);
  return out;
}

}  // namespace waymark::slam
