// A seeded poster, and what a camera sees of it: brute force, independent of what is tested.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/image_view.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"

namespace waymark::slam::testing {

inline ImageView viewOf(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, static_cast<std::ptrdiff_t>(image.step)};
}

// Discs, bars and letters of all sizes on a shaded ground.
inline cv::Mat poster(unsigned seed, int width = 480, int height = 360) {
  std::mt19937 rng(seed);
  const auto uniform = [&rng](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(rng);
  };
  cv::Mat image(height, width, CV_8U);
  const double slope = uniform(-40.0, 40.0);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(130.0 + slope * x / width);
    }
  }
  for (int i = 0; i < 60; ++i) {
    const double size = height * 0.25 * std::pow(0.93, i);
    const cv::Point at(static_cast<int>(uniform(0.0, width)),
                       static_cast<int>(uniform(0.0, height)));
    const cv::Scalar grey = cv::Scalar::all(uniform(20.0, 235.0));
    if (i % 3 == 0) {
      cv::circle(image, at, static_cast<int>(0.5 * size) + 2, grey, cv::FILLED, cv::LINE_AA);
    } else if (i % 3 == 1) {
      const cv::Size2f sides(static_cast<float>(size + 3.0),
                             static_cast<float>(size * uniform(0.2, 1.0) + 3.0));
      const cv::RotatedRect bar(at, sides, static_cast<float>(uniform(0.0, 180.0)));
      cv::Point2f corners[4];
      bar.points(corners);
      cv::Point polygon[4];
      std::transform(corners, corners + 4, polygon,
                     [](const cv::Point2f& p) { return cv::Point(cvRound(p.x), cvRound(p.y)); });
      cv::fillConvexPoly(image, polygon, 4, grey, cv::LINE_AA);
    } else {
      const std::string letter(1, static_cast<char>('A' + static_cast<int>(uniform(0.0, 25.99))));
      cv::putText(image, letter, at, cv::FONT_HERSHEY_SIMPLEX, 0.02 * size + 0.3, grey,
                  1 + static_cast<int>(size / 20.0), cv::LINE_AA);
    }
  }
  return image;
}

// A notice: a picture, and below it lines of made-up words, one much like the next.
inline cv::Mat notice(unsigned seed, int width = 360, int height = 480) {
  constexpr int kLine_px = 14;
  std::mt19937 rng(seed);
  cv::Mat image(height, width, CV_8U, cv::Scalar(215));
  const cv::Rect top(20, 20, width - 40, 2 * height / 5);
  poster(seed, top.width, top.height).copyTo(image(top));
  for (int y = top.br().y + 2 * kLine_px; y + kLine_px < height; y += kLine_px) {
    std::string words;
    for (int i = 0; i < 38; ++i) {
      words += rng() % 6 == 0 ? ' ' : static_cast<char>('a' + static_cast<int>(rng() % 26));
    }
    cv::putText(image, words, cv::Point(20, y), cv::FONT_HERSHEY_SIMPLEX, 0.4, cv::Scalar(40), 1,
                cv::LINE_AA);
  }
  image.colRange(width - 20, width).setTo(215);
  return image;
}

struct PictureScene {
  CameraModel camera;
  double blur_px = 0.6;  // Gaussian, on top of the pixel's own area
  double noise = 2.0;    // grey levels
  double gain = 0.8;     // of the print's grey levels
  double offset = 15.0;
};

// A picture of the given size in metres at T_c_p, before a wall of smooth noise.
inline cv::Mat seenPicture(const PictureScene& scene, const cv::Mat& picture, double width_m,
                           double height_m, const Transform& T_c_p, unsigned seed) {
  constexpr int kPlaces = 6;  // each way, per pixel
  const Transform T_p_c = T_c_p.inverse();
  std::mt19937 rng(seed);
  const int width = scene.camera.width();
  const int height = scene.camera.height();
  cv::Mat wall(height / 24 + 2, width / 24 + 2, CV_32F);
  for (int i = 0; i < static_cast<int>(wall.total()); ++i) {
    wall.at<float>(i) = static_cast<float>(std::uniform_real_distribution<double>(80, 170)(rng));
  }
  cv::Mat light;
  cv::resize(wall, light, cv::Size(width, height), 0.0, 0.0, cv::INTER_CUBIC);
  // Places of a pixel are averaged exactly as far as the print is smooth between its own pixels;
  // where it is seen smaller it is reduced first.
  const double covered = scene.camera.focalLength() * width_m / T_c_p.p.z();
  cv::Mat print = picture;
  while (print.cols > 3.0 * kPlaces * covered) {
    cv::resize(print, print, cv::Size(), 0.5, 0.5, cv::INTER_AREA);
  }
  const auto greyAt = [&](double x_m, double y_m) {
    const double x = std::clamp((x_m / width_m + 0.5) * print.cols - 0.5, 0.0, print.cols - 1.001);
    const double y = std::clamp((0.5 - y_m / height_m) * print.rows - 0.5, 0.0, print.rows - 1.001);
    const int c = static_cast<int>(x);
    const int r = static_cast<int>(y);
    const auto at = [&](int row, int column) {
      return static_cast<double>(print.at<std::uint8_t>(row, column));
    };
    const double top = at(r, c) + (x - c) * (at(r, c + 1) - at(r, c));
    const double low = at(r + 1, c) + (x - c) * (at(r + 1, c + 1) - at(r + 1, c));
    return scene.gain * (top + (y - r) * (low - top)) + scene.offset;
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto middle = scene.camera.undistort({x, y});
      if (!middle) continue;
      const Eigen::Vector3d d0 = T_p_c.R * middle->homogeneous();
      const Eigen::Vector3d p0 = T_p_c.p - d0 * (T_p_c.p.z() / d0.z());
      if (T_p_c.p.z() / d0.z() > 0.0 || std::abs(p0.x()) > 0.6 * width_m ||
          std::abs(p0.y()) > 0.6 * height_m) {
        continue;
      }
      double sum = 0.0;
      for (int i = 0; i < kPlaces; ++i) {
        for (int k = 0; k < kPlaces; ++k) {
          const Eigen::Vector2d pixel(x + (i + 0.5) / kPlaces - 0.5, y + (k + 0.5) / kPlaces - 0.5);
          const auto ray = scene.camera.undistort(pixel);
          if (!ray) continue;
          const Eigen::Vector3d d = T_p_c.R * ray->homogeneous();
          const Eigen::Vector3d p = T_p_c.p - d * (T_p_c.p.z() / d.z());
          const bool on = std::abs(p.x()) <= 0.5 * width_m && std::abs(p.y()) <= 0.5 * height_m;
          sum += on ? greyAt(p.x(), p.y()) : static_cast<double>(light.at<float>(y, x));
        }
      }
      light.at<float>(y, x) = static_cast<float>(sum / (kPlaces * kPlaces));
    }
  }
  if (scene.blur_px > 0.0) cv::GaussianBlur(light, light, cv::Size(), scene.blur_px);
  std::normal_distribution<double> noise(0.0, 1.0);
  cv::Mat image(height, width, CV_8U);
  for (int i = 0; i < static_cast<int>(image.total()); ++i) {
    const double grey = light.at<float>(i) + scene.noise * noise(rng);
    image.at<std::uint8_t>(i) = cv::saturate_cast<std::uint8_t>(grey);
  }
  return image;
}

// A camera that sees the middle of a print from `distance_m`, from `tilt_rad` off its normal in the
// direction `way_rad`, turned by roll_rad.
inline Transform pictureAt(double distance_m, double tilt_rad, double way_rad, double roll_rad) {
  Transform T_c_p;
  Eigen::Matrix3d facing;  // upright and square on: x right, y up, z towards the camera
  facing << 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0;
  const Eigen::Vector3d axis(std::cos(way_rad), std::sin(way_rad), 0.0);
  T_c_p.R = expSo3({0.0, 0.0, roll_rad}) * expSo3(tilt_rad * axis) * facing;
  T_c_p.p = {0.0, 0.0, distance_m};
  return T_c_p;
}

}  // namespace waymark::slam::testing
