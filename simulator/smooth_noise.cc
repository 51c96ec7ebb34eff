#include "simulator/smooth_noise.h"

#include <algorithm>

#include <opencv2/imgproc.hpp>

namespace waymark::simulator {

cv::Mat smoothNoise(const cv::Size& size, double wavelength, double amplitude, Random* random) {
  cv::Mat lattice(std::max(2, static_cast<int>(size.height / wavelength) + 2),
                  std::max(2, static_cast<int>(size.width / wavelength) + 2), CV_32F);
  for (int i = 0; i < static_cast<int>(lattice.total()); ++i) {
    lattice.at<float>(i) = static_cast<float>(random->uniform(-amplitude, amplitude));
  }
  cv::Mat noise;
  cv::resize(lattice, noise, size, 0.0, 0.0, cv::INTER_CUBIC);
  return noise;
}

cv::Mat clouds(const cv::Size& size, double longest, double amplitude, double fall,
               Random* random) {
  cv::Mat sum = cv::Mat::zeros(size, CV_32F);
  for (double wavelength = longest; wavelength > 3.0; wavelength *= 0.5, amplitude *= fall) {
    sum += smoothNoise(size, wavelength, amplitude, random);
  }
  return sum;
}

}  // namespace waymark::simulator
