#include "slam/natural/pictures/picture_points.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "slam/natural/pictures/opencv_view.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

struct Corner {
  Eigen::Vector2d at = Eigen::Vector2d::Zero();  // pixels of the level
  float strength = 0.0F;                         // smaller eigenvalue of the gradients' matrix
};

// Local maxima of Shi and Tomasi's measure, the strongest first.
std::vector<Corner> cornersOf(const GreyImage<std::uint8_t>& picture, int border_px) {
  constexpr int kWindow_px = 5;
  const cv::Mat grey = matOf({picture.grey.data(), picture.width, picture.height, picture.width});
  cv::Mat strength;
  cv::cornerMinEigenVal(grey, strength, kWindow_px);
  cv::Mat around;
  cv::dilate(strength, around, cv::Mat());
  std::vector<Corner> corners;
  for (int y = border_px; y < picture.height - border_px; ++y) {
    for (int x = border_px; x < picture.width - border_px; ++x) {
      const float s = strength.at<float>(y, x);
      if (s > 0.0F && s == around.at<float>(y, x)) corners.push_back({{x, y}, s});
    }
  }
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Corner& a, const Corner& b) { return a.strength > b.strength; });
  return corners;
}

double distanceTo(const std::vector<Eigen::Vector2d>& taken, const Eigen::Vector2d& point) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector2d& other : taken) nearest = std::min(nearest, (other - point).norm());
  return nearest;
}

// The corner with the most of `worth`, among those that are not too near to others. False when
// there is none.
template <typename Worth>
bool takeBest(const std::vector<Corner>& corners, double apart_px, const Worth& worth,
              std::vector<Eigen::Vector2d>* taken) {
  const Corner* best = nullptr;
  double most = 0.0;
  for (const Corner& corner : corners) {
    if (distanceTo(*taken, corner.at) < apart_px) continue;
    const double value = worth(corner.at);
    if (best != nullptr && value <= most) continue;
    best = &corner;
    most = value;
  }
  if (best == nullptr) return false;
  taken->push_back(best->at);
  return true;
}

}  // namespace

std::string PicturePointsOptions::invalidReason() const {
  return firstUnmet({
      {most >= 0, "the number of a picture's points must not be negative"},
      {isShare(best_share), "the share of corners is from 0 to 1"},
      {least_considered >= 1, "at least 1 corner must be considered"},
      {apart >= 0.0 && apart < 0.5, "points are 0 to 0.5 of a picture's side apart"},
      {side_px >= 16, "points are looked for at 16 pixels at least"},
  });
}

std::vector<Eigen::Vector2d> picturePoints(const NaturalMarker& marker,
                                           const PicturePointsOptions& options) {
  int level = 0;
  const auto longer = [&](int i) {
    return std::max(marker.grey().level(i).width, marker.grey().level(i).height);
  };
  while (level + 1 < marker.grey().levels() && longer(level + 1) >= options.side_px) ++level;
  const auto& picture = marker.grey().level(level);
  const double apart_px = options.apart * std::min(picture.width, picture.height);
  std::vector<Corner> corners = cornersOf(picture, std::max(3, static_cast<int>(apart_px)));
  const auto share =
      static_cast<std::size_t>(options.best_share * static_cast<double>(corners.size()));
  const std::size_t considered =
      std::max(share, static_cast<std::size_t>(options.least_considered));
  if (corners.size() > considered) corners.resize(considered);

  const auto most = static_cast<std::size_t>(options.most);
  std::vector<Eigen::Vector2d> taken;
  for (const double x : {0.0, picture.width - 1.0}) {
    for (const double y : {0.0, picture.height - 1.0}) {
      if (taken.size() >= most) break;
      const Eigen::Vector2d corner(x, y);
      (void)takeBest(
          corners, apart_px, [&](const Eigen::Vector2d& at) { return -(at - corner).norm(); },
          &taken);
    }
  }
  while (taken.size() < most &&
         takeBest(
             corners, apart_px, [&](const Eigen::Vector2d& at) { return distanceTo(taken, at); },
             &taken)) {
  }
  std::vector<Eigen::Vector2d> points;
  for (const Eigen::Vector2d& at : taken) {
    points.emplace_back(((at.x() + 0.5) / picture.width - 0.5) * marker.width_m(),
                        (0.5 - (at.y() + 0.5) / picture.height) * marker.height_m());
  }
  return points;
}

}  // namespace waymark::slam
