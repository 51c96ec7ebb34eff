#include "simulator/printed_image.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace waymark::simulator {

PrintedImage::PrintedImage(ImageView picture, double ink, double paper) {
  const cv::Mat given(picture.height, picture.width, CV_8U, const_cast<std::uint8_t*>(picture.data),
                      static_cast<std::size_t>(picture.stride));
  cv::Mat grey;
  given.convertTo(grey, CV_32F, (paper - ink) / 255.0, ink);
  const int full_width = grey.cols;
  const int full_height = grey.rows;
  while (true) {
    levels_.push_back({grey.cols, grey.rows,
                       static_cast<float>(grey.cols) / static_cast<float>(full_width),
                       static_cast<float>(grey.rows) / static_cast<float>(full_height),
                       std::vector<float>(grey.begin<float>(), grey.end<float>())});
    if (std::min(grey.cols, grey.rows) < 4) return;
    cv::Mat half;
    cv::resize(grey, half, cv::Size(grey.cols / 2, grey.rows / 2), 0.0, 0.0, cv::INTER_AREA);
    grey = half;
  }
}

}  // namespace waymark::simulator
